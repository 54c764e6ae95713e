"""The first sentence of a diagnosis, and what it must not keep to itself."""

from dataclasses import replace

from diagnosed import calm, windy

from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS, still_missing
from manoeuvre_nn.diagnosis.result import Check
from manoeuvre_nn.diagnosis.words import summary_sentence


def test_the_first_sentence_says_what_the_repaired_model_still_misses():
    """A large gain is no success as long as free runs are off by more than they should be."""
    missed = "free runs of the repaired model miss the recorded x of r05 by 5.6 times what is unknown about it"
    passed, failed = (Check(REPAIRED_SAILS, good, f"{missed}: p = 0.0008") for good in (True, False))
    d = windy()
    for checks, end in (((passed,), ""), ((failed,), f"; something is still missing: {missed}"), ((), "")):
        for model in (d.model, ["unknown"]):
            plain = summary_sentence(d.causes, model, d.proofs, True)
            told = summary_sentence(d.causes, model, d.proofs, True, left=still_missing(checks))
            assert told == f"{plain.removesuffix('.')}{end}."


def test_corrected_coefficients_are_told_where_two_digits_show_what_they_gain():
    p, agrees = calm().proofs[0], "The recordings agree with the calm-water model"
    for before, after, told in ((15.7, 15.6, False), (20.0, 4.0, True)):
        proofs = [replace(p, rmse_before={"pos": before}, rmse_after={"pos": after})]
        said = summary_sentence([], [], proofs, False)
        assert said.startswith(agrees) and ("is 4 m off instead of 20 m" in said) == told == (
            "coefficients cor" in said
        )
