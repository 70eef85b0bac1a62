"""The arms against 128 states computed from positions alone with 50 digits, and the report's misprints."""

import json
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde

FOLDER = Path(__file__).parents[1] / "oracles"
ARMS = {"rprp": rde.RPRP, "four_r": rde.FourR}


def cases(arm):
    """The oracle's cases with arrays for lists."""
    data = json.loads((FOLDER / f"{arm}.json").read_text(encoding="utf-8"))["cases"]
    return [{k: np.array(v) if isinstance(v, list) else v for k, v in c.items()} for c in data]


CASES = {arm: cases(arm) for arm in ARMS}
PARAMETERS = [pytest.param(a, c, id=f"{a}-{c['id']}") for a in ARMS for c in CASES[a]]


def robot_of(arm, case):
    return ARMS[arm](tuple(case["m"]), tuple(case["l"]))


def close(value, reference, tolerance, scale=None):
    """Whether the largest difference is within the tolerance of the scale."""
    reference = np.asarray(reference)
    assert np.shape(value) == reference.shape
    scale = np.abs(reference).max() if scale is None else scale
    return np.abs(value - reference).max() <= tolerance * scale


def test_there_are_64_cases_each():
    """Some with rates, gravity and forces, some without gravity."""
    for found in CASES.values():
        assert len(found) == 64
        assert {c["g"] for c in found} == {0.0, 9.81}
        assert all(np.abs(c["qd"]).min() > 0.0 and len(set(c["m"])) == 4 for c in found)


@pytest.mark.parametrize(("arm", "case"), PARAMETERS)
def test_dynamics(arm, case):
    """M, h, G and the accelerations."""
    robot = robot_of(arm, case)
    q, qd, g = case["q"], case["qd"], case["g"]
    assert close(robot.mass_matrix(q), case["M"], 1e-14)
    assert close(robot.bias_forces(q, qd), case["h"], 1e-14)
    if g == 0.0:
        assert (case["G"] == 0.0).all()
        assert (robot.gravity_forces(q, g) == 0.0).all()
    else:
        assert close(robot.gravity_forces(q, g), case["G"], 1e-14)
    factor = min(10.0, max(1.0, case["cond_M"] / 100.0))
    assert close(robot.forward_dynamics(q, qd, case["Q"], g), case["qdd"], 1e-13 * factor)
    scale = np.abs(case["M"]).max() * np.abs(case["qdd"]).max() + np.abs(case["h"]).max()
    assert close(robot.inverse_dynamics(q, qd, case["qdd"], g), case["Q"], 1e-14, scale)


@pytest.mark.parametrize(("arm", "case"), PARAMETERS)
def test_kinematics_and_invariants(arm, case):
    """J, the tip, its acceleration at qdd = 0, energies and angular momentum."""
    robot = robot_of(arm, case)
    m, q, qd, g = case["m"], case["q"], case["qd"], case["g"]
    reach = case["l"].sum() + (np.abs(q[[1, 3]]).sum() if arm == "rprp" else 0.0)
    assert close(robot.jacobian(q), case["J"], 1e-14)
    assert close(robot.forward_kinematics(q), case["tip"], 1e-15, reach)
    assert close(robot.points(q)[3], case["tip"], 1e-15, reach)
    terms = np.abs(case["J"]).max() * (qd**2).sum() + np.abs(qd).max() ** 2
    assert close(robot.jacobian_dot_qd(q, qd), case["Jdot_qd"], 2e-15, terms)
    speeds = np.abs(qd) @ np.abs(case["M"]) @ np.abs(qd)
    assert close(robot.kinetic_energy(q, qd), case["T"], 1e-15, speeds)
    momenta = np.abs(case["M"]) @ np.abs(qd)
    assert close(robot.angular_momentum(q, qd), case["Lz"], 1e-15, momenta.sum())
    assert close(robot.potential_energy(q, g), case["U"], 1e-15, m.sum() * g * reach)


# ---- the report's five wrong terms: the entries as printed, each misprint by a switch -------------


def rprp_entries(m, l, q, qd, wrong):
    """h1 and h3 as the report prints them (section 1.3), without gravity; misprints in ``wrong`` stay."""
    _m1, m2, m3, m4 = m
    l1, l2 = l
    t1, r1, t2, r2 = q
    t1d, r1d, t2d, r2d = qd
    s, c = np.sin(t1 - t2), np.cos(t1 - t2)
    h1 = 2 * m2 * r1d * t1d + 2 * m3 * r1d * t1d + 2 * m4 * r1d * t1d
    h1 += m3 * l2 * s * t2d**2 + m4 * l2 * s * t2d**2 + 2 * m4 * r2d * t2d * c
    h1 = (h1 + m4 * s * (r2d if 1 in wrong else r2) * t2d**2) * (l1 + r1)
    h3 = 2 * m4 * l2 * r2d * t2d + 2 * m4 * r2 * r2d * t2d - m3 * l2 * s * r1 * t1d**2
    h3 += -m4 * l1 * s * r2 * t1d**2 - m4 * l2 * s * r1 * t1d**2 + 2 * m4 * r2 * r1d * t1d * c
    h3 += -m4 * s * r1 * r2 * t1d**2 - m3 * l1 * l2 * s * t1d**2 - m4 * l1 * l2 * s * t1d**2
    h3 -= m4 * l1 * l2 * s * t1d**2 if 2 in wrong else 0.0
    h3 += 2 * m3 * l2 * r1d * t1d * c + (1 if 3 in wrong else 2) * m4 * l2 * r1d * t1d * c
    return {"h1": h1, "h3": h3}


def four_r_entries(m, l, q, qd, wrong):
    """M33 and h4 as the report prints them (section 2.3)."""
    _m1, _m2, m3, m4 = m
    l1, l2, l3, l4 = l
    t1, t2, t3, t4 = q
    w1, w2, w3, _w4 = qd
    m33 = (m3 + m4) * l2 * l3 * np.cos(t3 - t2) if 4 in wrong else (m3 + m4) * l3**2
    h4 = m4 * l1 * l4 * np.sin(t4 - t1) * w1**2 + m4 * l2 * l4 * np.sin(t4 - t2) * w2**2
    h4 += m4 * l3 * l4 * (m4 if 5 in wrong else 1.0) * np.sin(t4 - t3) * w3**2
    return {"M33": m33, "h4": h4}


ENTRIES = {"rprp": rprp_entries, "four_r": four_r_entries}
PLACES = {"h1": ("h", 0), "h3": ("h", 2), "h4": ("h", 3), "M33": ("M", (2, 2))}
WRONG = [  # number, arm, entry, its relative error at the nominal state
    (1, "rprp", "h1", 0.096),
    (2, "rprp", "h3", 0.17),
    (3, "rprp", "h3", 0.055),
    (4, "four_r", "M33", 0.10),
    (5, "four_r", "h4", 0.20),
]
NOMINAL = {
    "rprp": ((2, 1.5, 1, 0.5), (1, 0.8), (0.6, 0.2, -0.4, 0.3), (1, 0.5, -1.5, 0.8)),
    "four_r": ((2, 1.5, 1, 0.5), (1, 0.8, 0.6, 0.4), (0.6, 0.2, -0.4, -1.0), (1, 0.5, -1.5, 0.8)),
}


def own_entry(robot, entry, q, qd):
    name, place = PLACES[entry]
    return {"M": robot.mass_matrix(q), "h": robot.bias_forces(q, qd)}[name][place]


def oracle_entry(case, entry):
    name, place = PLACES[entry]
    return case[name][place], np.abs(case[name]).max()


@pytest.mark.parametrize(("number", "arm", "entry", "size"), WRONG)
def test_each_printed_misprint_disagrees_with_the_oracle_and_the_package(number, arm, entry, size):
    """One misprint restored at a time: the states see it (one in 64 may be blind to it), the package does not
    have it, all other entries as printed are right, and at the nominal state it has the size that the errata
    state."""
    seen = own_differs = 0
    for case in CASES[arm]:
        printed = ENTRIES[arm](case["m"], case["l"], case["q"], case["qd"], (number,))
        for name, value in printed.items():
            reference, scale = oracle_entry(case, name)
            wrong = abs(value - reference) > (1e-6 if name == entry else 2e-14) * scale
            assert name == entry or not wrong
            seen += wrong
        own = own_entry(robot_of(arm, case), entry, case["q"], case["qd"])
        own_differs += abs(own - printed[entry]) > 1e-6 * oracle_entry(case, entry)[1]
    assert own_differs == seen >= 63
    m, l, q, qd = NOMINAL[arm]
    own = own_entry(ARMS[arm](m, l), entry, q, qd)
    assert abs(ENTRIES[arm](m, l, q, qd, (number,))[entry] / own - 1.0) == pytest.approx(size, rel=0.06)


def test_printed_mass_matrix_is_often_indefinite():
    """The printed M33 makes M of the 4R arm indefinite in most states; the corrected one never is."""
    indefinite = 0
    for case in CASES["four_r"]:
        M = robot_of("four_r", case).mass_matrix(case["q"])
        assert np.linalg.eigvalsh(M).min() > 0.0
        M[2, 2] = four_r_entries(case["m"], case["l"], case["q"], case["qd"], (4,))["M33"]
        indefinite += np.linalg.eigvalsh(M).min() < 0.0
    assert indefinite > 32
