"""Numbers of the manual that somebody measured are claims, which make claims measures again."""

import runpy

from markdown import ROOT

docs = runpy.run_path(str(ROOT / "docs" / "claims.py"))


def test_a_claim_has_a_number_on_its_page_for_each_measurement():
    for group, claims in docs["claims"]().items():
        assert group in docs["GROUPS"]
        for claim in claims:
            names = [claim["is"]] if isinstance(claim["is"], str) else claim["is"]
            assert len(docs["stated"](claim)) == len(names)
            assert ("within" in claim) != ("plus" in claim)
