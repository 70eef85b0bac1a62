"""Lanes that one step does not serve: gathered eight at a time for the same compiled step.

The text below the line is copied into the assembled module of a scene with a tolerance; the names
it uses (rows of the memory, ``step``) are that module's.
"""

# ---- copied from here ----------------------------------------------------------------------------


@njit(inline="always", **OPTIONS)
def redo(W, first, last):
    """Advance the marked ones of the lanes first to last anew, each with steps of its own.

    A slot of the scratch block S that falls free takes the next marked lane, so no lane waits for
    its neighbours; and since each slot has its own h, none knows of them.
    """
    wide_vectors()
    S = np.zeros(STRIDE)
    home = np.full(LANES, -1)  # where the lane in a slot lives in W
    upcoming = first
    busy = 0
    while True:
        for i in range(LANES):
            while home[i] < 0 and upcoming < last:
                w = upcoming // LANES * STRIDE + upcoming % LANES
                upcoming += 1
                if W[w + MARKED] > 0.0:
                    for row in range(LIVE):
                        S[row * LANES + i] = W[w + row * LANES]
                    begin_lane(S, i)
                    home[i] = w
                    busy += 1
        if busy == 0:
            return
        step(S, 0)
        for i in range(LANES):
            if home[i] >= 0 and lane_done(S, i):
                for row in range(RESULTS):
                    W[home[i] + row * LANES] = S[row * LANES + i]
                home[i] = -1
                busy -= 1


@njit(**OPTIONS)
def begin_lane(S, i):
    """Choose the number of steps of a lane whose single step does not do.

    The estimate of n equal steps falls like n^-7; a number that would fail by far is not tried.
    """
    n = 2.0
    while n < MOST_STEPS and n < S[i + FLOOR]:
        n *= 2.0
    while n < MOST_STEPS and S[i + ERROR_SUM] > 4.0 * S[i + TIP_TOLERANCE] * n**7:
        n *= 2.0
    start_lane(S, i, n)


@njit(**OPTIONS)
def start_lane(S, i, n):
    """Put a lane back to the start of its interval, to cross it in n equal steps."""
    for k in range(STATES):
        S[i + k * LANES] = S[i + BEFORE + k * LANES]
    S[i + H] = S[i + INTERVAL] / n
    S[i + STEPS_LEFT] = n
    S[i + STEPS_OF_LANE] = n
    S[i + ERROR_SUM] = 0.0


@njit(**OPTIONS)
def lane_done(S, i):
    """After a step of a lane: whether its interval is complete; if its error is too large, anew."""
    n = S[i + STEPS_OF_LANE]
    S[i + EVALUATIONS] += STAGES
    S[i + STEPS_LEFT] -= 1.0
    passes = S[i + ERROR_SUM] <= S[i + TIP_TOLERANCE]
    if not passes and n < MOST_STEPS:
        start_lane(S, i, 2.0 * n)
        return False
    if S[i + STEPS_LEFT] > 0.0:
        return False
    if not passes or S[i + FLOOR] > MOST_STEPS:
        S[i + TROUBLE] = TOLERANCE_NOT_REACHED
    return True
