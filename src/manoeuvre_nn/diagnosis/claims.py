"""What may be claimed: claims put to held-out runs, to tests, and beside calm water.

Of all that the search found the first claim is named that predicts runs which it has not seen better.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from manoeuvre_nn.diagnosis import checks as checking
from manoeuvre_nn.diagnosis.case import Question
from manoeuvre_nn.diagnosis.decision import Decision, are_rivals, decide, is_simpler, likelier_than_calm_water
from manoeuvre_nn.diagnosis.fits import at_rest, over_directions, refine
from manoeuvre_nn.diagnosis.gusts import averaged_over_gusts, fainter_than_at_sea, refined_with_gusts
from manoeuvre_nn.diagnosis.predictive import REPAIRED_SAILS, calm_check, repaired_check
from manoeuvre_nn.diagnosis.proof import in_held_out_runs, prove
from manoeuvre_nn.diagnosis.result import GAIN, Check, Proof
from manoeuvre_nn.diagnosis.right_ship import right_ship_check
from manoeuvre_nn.diagnosis.search import MIN_GAIN_OF_SECOND, SearchResult
from manoeuvre_nn.diagnosis.windows import acting
from manoeuvre_nn.diagnosis.words import labels
from manoeuvre_nn.diagnosis.workers import shared_out
from manoeuvre_nn.dynamics.base import is_fitted
from manoeuvre_nn.effect.formula import Formula
from manoeuvre_nn.estimation.data_set import WhitenedDataSet
from manoeuvre_nn.estimation.hypothesis import FittedHypothesis, Hypothesis
from manoeuvre_nn.estimation.marginal_likelihood import MarginalLikelihood
from manoeuvre_nn.estimation.noise_average import averaged
from manoeuvre_nn.scoring.free_runs import cost, counted_as_one

MIN_GAIN_OF_NAMED, SURE_BY_ITSELF = 5.0, 8.0
"""Least log Bayes factor over calm water of a named effect, in fitted and held-out runs together: fewer than 1 % of
clean cases reach it by any of some 25 candidates. With K the prior variance of its numbers over that of their errors it
is ``chi^2 / 2 K / (1 + K) - k / 2 ln(1 + K)`` for k numbers: where chi^2 is what one of 2500 exceeds, at most 4.5 for
one number and 5.0 for four, whatever K. And the one that fewer reach whatever is compared (Markov's inequality): what
held-out runs alone must have where free runs get worse, and all runs where errors of a fitted model may look like an
effect."""
PROVED = 3.0
"""Log evidence that a formula must add on held-out runs, and any effect where the model was fitted."""
REFUTED = -5.0
"""Log evidence of the held-out runs that refutes any other effect: odds of 150 to 1 against it, whether coefficients
are known from the fitted runs or not. Less is weighed with what the fitted runs say."""
MAX_ERROR_GROWTH = 1.05
"""Growth of the error of free runs beyond which an effect is not named. Of a model that was fitted it must not grow at
all, unless the log evidence of the held-out runs alone is enough for the name."""
Proved = tuple[FittedHypothesis, list[Proof], list[Check]]
"""A hypothesis, the held-out runs predicted with it, and the tests that it and the claims before it were put to."""


def decided(question: Question, tried: SearchResult) -> tuple[Decision, Proved]:
    """What may be claimed and what of it was proved; whether calm water could have sailed the runs, and this ship.

    Args:
        question: What is asked.
        tried: The search.

    Returns:
        The weights of all causes, held-out runs counted; what is claimed of them.
    """
    verdict = decide(tried)
    if is_fitted(question.dynamics):
        return verdict, _proved(question, tried, verdict.claims)
    as_fitted = verdict
    if verdict.lead and question.case.held_out:
        asked = filter(None, (verdict.best, verdict.formula))
        verdict = verdict.with_held_out(*(held_out_gain(question, tried, j) for j in asked))
    ship = right_ship_check(tried, verdict.formula)
    chosen, proofs, checks = _proved(question, tried, verdict.claims, ship)
    named = verdict.best is not None and set(chosen.names) == set(verdict.best.names)
    if named and verdict is not as_fitted and any(c.name == REPAIRED_SAILS and not c.passed for c in checks):
        # Fitted runs call it unknown: held-out ones bear out its name only if they are sailed with it.
        named, (chosen, proofs, checks) = False, _proved(question, tried, as_fitted.claims, ship)
    if not named:
        verdict = as_fitted  # a name that failed the proof makes the unknown no less likely
    rule = verdict.formula if verdict.rests_on_formula and not chosen.names else None
    if rule is not None and held_out_gain(question, tried, rule) < REFUTED:
        verdict = verdict.without_formula()
        chosen, proofs, more = _proved(question, tried, verdict.claims, ship)
        checks = [*checks, *more]
    if not verdict.mismatch(chosen):
        if verdict.best is not None and verdict.named and _outweighed(question, tried, verdict.best):
            verdict = verdict.with_calm_water()
        check = calm_check(question, tried)
        if not (check.passed and ship.passed):
            verdict = verdict.without_calm_water(tried, named=not check.passed)
            chosen, proofs, checks = _proved(question, tried, verdict.claims, ship)
        checks = [check, *checks]
    return verdict, (chosen, proofs, [ship, *checks])


def _outweighed(question: Question, tried: SearchResult, best: FittedHypothesis) -> bool:
    """Whether fitted and held-out runs together make calm water likelier than a hypothesis with a name."""
    evidence = best.evidence + held_out_gain(question, tried, best)
    return not likelier_than_calm_water(tried, replace(best, evidence=evidence))


def held_out_gain(question: Question, tried: SearchResult, claim: FittedHypothesis) -> float:
    """Log evidence that a claim adds to calm water's in the held-out runs."""
    calm = in_held_out_runs(question, tried.none, tried.likelihood.data_set).evidence
    return _held_out_evidence(question, tried, claim) - calm


def _held_out_evidence(question: Question, tried: SearchResult, claim: FittedHypothesis) -> float:
    """Log evidence of the held-out runs under a claim as it is put to the proof; several ask for that of one part."""
    if id(claim) not in question.held_out_evidence:
        known, j = _as_put_to_proof(question, tried, claim)
        question.held_out_evidence[id(claim)] = claim, in_held_out_runs(question, j, known).evidence
    return question.held_out_evidence[id(claim)][1]


def _proved(question: Question, tried: SearchResult, claims: Sequence[FittedHypothesis], *before_it: Check) -> Proved:
    """The first claim that predicts runs which it has not seen better; calm water if none does."""
    none, known = tried.none, dict[int, Tried]()
    proofs = prove(question, none, none.hypothesis)
    before = _cost(question, [p.rmse_before for p in proofs])
    calm = in_held_out_runs(question, none, tried.likelihood.data_set).evidence
    calm_water = proofs, before, calm

    def put(some: Sequence[FittedHypothesis]) -> list[Tried]:
        new = [c for c in some if id(c) not in question.put_to_proof]
        made = shared_out([partial(_put_to_proof, question, tried, c, calm_water) for c in new], question.workers)
        for c, found in zip(new, made, strict=True):
            question.put_to_proof[id(c)] = c, found
            question.held_out_evidence[id(c)] = c, found.evidence - c.evidence
        for c in some:
            if id(c) not in known:
                known[id(c)] = _beside_fewer(question, tried, claims, *question.put_to_proof[id(c)])
        return [known[id(c)] for c in some]

    left, second_best = list(claims), None
    while left:
        claim = left.pop(0)
        if not put([claim])[0].helped:
            continue
        # What the fitted runs leave open others may settle.
        rivals = [c for c in claims if Formula.name not in (*c.names, *claim.names) and are_rivals(claim, c)]
        best = max((t for t in put([claim, *rivals]) if t.helped), key=lambda t: t.evidence)
        sailed = [repaired_check(question, tried, best.fitted, best.there)] if question.case.held_out else []
        of_best = [*sailed, *checking.checks(tried, best.fitted)]
        more_left = checking.more_is_left(tried, best.fitted)
        why = checking.only_nearest(best.fitted, [*of_best, *before_it], more_left)
        passed = best.fitted, best.proofs, [*(t.check for t in known.values()), *of_best]
        if not why and second_best and error_after(question, second_best[1]) < error_after(question, best.proofs):
            break  # events that do not sail held-out runs are nearer to these than what would take their place
        if not why:
            return passed
        if why == checking.ANY_FORCE and second_best is None:
            second_best = passed
        key = next(k for k, t in known.items() if t is best)
        known[key] = replace(best, check=Check(GAIN, False, f"{best.check.text}; {why}"), likelier=False)
        left.insert(0, claim)  # or what may take its place
    if strayed := _strayed(question, tried, known.values()):
        return strayed
    if second_best:
        return second_best
    # Nothing is missing, but coefficients may be off within their scatter.
    corrected = prove(question, none, none.hypothesis, proofs) if proofs else []
    better = error_after(question, corrected) < before
    return none, corrected if better else proofs, [t.check for t in known.values()]


def _strayed(question: Question, tried: SearchResult, put: Collection["Tried"]) -> Proved | None:
    """The likeliest of all that was put to the proof, if nothing but its free runs speaks against it."""
    likeliest = max(put, key=lambda t: t.evidence, default=None)
    if likeliest is None or not likeliest.likelier or likeliest.helped:
        return None
    free = repaired_check(question, tried, likeliest.fitted, likeliest.there)
    if not free.passed:
        return None
    why = "; free runs of this ship may go so far astray, and their log evidence alone would be enough"
    check = replace(likeliest.check, passed=True, text=likeliest.check.text + why)
    told = [check if t is likeliest else t.check for t in put]
    return likeliest.fitted, likeliest.proofs, [*told, free, *checking.checks(tried, likeliest.fitted)]


@dataclass(frozen=True)
class Tried:
    """A claim that was put to the proof.

    Attributes:
        fitted: It, about its own states.
        there: It, in the held-out runs.
        proofs: These, predicted with it.
        check: What came out.
        evidence: Log evidence of fitted and held-out runs together.
        likelier: Whether held-out runs alone have evidence enough, however far free runs of calm water and of it stray.
    """

    fitted: FittedHypothesis
    there: Hypothesis
    proofs: list[Proof]
    check: Check
    evidence: float
    likelier: bool

    @property
    def helped(self) -> bool:
        """Whether it passed."""
        return self.check.passed


def _put_to_proof(
    question: Question,
    tried: SearchResult,
    claim: FittedHypothesis,
    calm_water: tuple[list[Proof], float, float],
) -> Tried:
    """One claim, against calm water's predictions, their error, and its log evidence in the held-out runs."""
    proofs, before, calm = calm_water
    known, j = _as_put_to_proof(question, tried, claim)
    there = in_held_out_runs(question, j, known)
    made = prove(question, j, there.hypothesis, proofs)
    # The errors of a fitted model may look like an effect, and one formula of hundreds like anything.
    trained = is_fitted(known.dynamics)
    least = PROVED if trained or Formula.name in j.names else REFUTED
    after, gain, sure = error_after(question, made), there.evidence - calm, least_gain(claim, SURE_BY_ITSELF)
    most = before * (1.0 if trained and gain <= sure else MAX_ERROR_GROWTH)
    alone = [p.rmse_alone for p in made if p.rmse_alone]
    if after > most and alone and _cost(question, alone) < after:
        # Coefficients as corrected by the fitted runs do not hold in others: the effects may.
        made = prove(question, replace(j, corrections=0 * j.corrections), there.hypothesis, proofs)
        after = error_after(question, made)
    enough = claim.evidence - tried.none.evidence + gain > (sure if trained else least_gain(claim))
    better = (gain > least or _likelier_by_themselves(question, tried.none, j, least)) and after <= most
    tested = bool(made) and any(acting(there.hypothesis, question.case.held_out))
    foretold = enough and (better if tested else not (trained and made))
    # Small errors of its state take free runs of a ship that is unstable on course far from any recording, whatever
    # the model: the likelihood of the recording does not suffer from that. Nor does it where gusts do, that nobody can
    # foretell.
    likelier = tested and gain > sure and (least == REFUTED or bool(j.random))
    faint = bool(j.random) and fainter_than_at_sea(j)
    by_itself = len(j.names) == 1 and Formula.name not in j.names
    unsure = by_itself and checking.may_be_nothing(j, 0, gain if tested else 0.0)
    why = "; gusts at sea are larger" if faint else "; its size is within its errors of none" if unsure else ""
    text = (
        f"with {labels(j)} the error of free runs goes from {before:.2f} to {after:.2f} ({unit_of_error(question)}), "
        f"and the log evidence of the held-out runs by {gain:+.0f}{why}"
    )
    untested = f"{labels(j)} did not act in a held-out run" if made else "no held-out run"
    check = Check(GAIN, foretold and not why, text if tested else f"{untested}: not proved{why}")
    return Tried(j, there.hypothesis, made, check, claim.evidence + there.evidence, likelier and not why)


def _beside_fewer(
    question: Question, tried: SearchResult, claims: Sequence[FittedHypothesis], claim: FittedHypothesis, found: Tried
) -> Tried:
    """What was put to the proof: what passed, or is likelier, is refused where a claim of less does as well."""
    promising = found.check.passed or found.likelier
    if not promising or _last_effect_helps(question, tried, claim, found.evidence - claim.evidence, claims):
        return found
    text = found.check.text + ("; less than that does as well" if found.check.passed else "")
    return replace(found, check=replace(found.check, passed=False, text=text), likelier=False)


def _likelier_by_themselves(question: Question, none: FittedHypothesis, j: FittedHypothesis, least: float) -> bool:
    """Whether held-out runs make a named effect likelier than calm water where nothing is known of coefficients.

    Coefficients that the fitted runs moved far, to explain without it what it does, do the same in the held-out ones:
    these say then which of the two is a little better, and not that they speak against it.

    Args:
        question: What is asked.
        none: Calm water.
        j: The claim.
        least: Log evidence that it must add; a formula and an effect beside a fitted model, which must add some, do not
            profit.

    Returns:
        Whether its log evidence there is larger by :data:`PROVED`.
    """
    if least > REFUTED:
        return False
    return in_held_out_runs(question, j).evidence - in_held_out_runs(question, none).evidence > PROVED


def _as_put_to_proof(
    question: Question, tried: SearchResult, claim: FittedHypothesis
) -> tuple[WhitenedDataSet, FittedHypothesis]:
    """The runs about a claim's own states, and the claim there, averaged, without what turned out to be nothing."""
    known, j = _about_own_states(tried.likelihood.data_set, claim)
    j = _averaged(known, j)
    gone = [k for k, acts in enumerate(acting(j.hypothesis, question.case.fitted)) if not acts]
    # An event that ends before it begins, or what may be nothing, the least clear first: what is left was found.
    by_chance = sorted(range(len(j.names)), key=lambda k: checking.chance_of_nothing(j, k), reverse=True)
    silent = [*gone, *(k for k in by_chance if checking.may_be_nothing(j, k))] if len(j.names) > 1 else []
    if silent:
        left = refine(MarginalLikelihood(known), j.hypothesis.without(silent[0]), *j.best)
        j = _averaged(known, replace(left, random=j.random))
    return known, j


def _averaged(known: WhitenedDataSet, j: FittedHypothesis) -> FittedHypothesis:
    """A hypothesis about its own states, averaged over what else may be."""
    return averaged_over_gusts(known, j) if j.random else over_directions(known, averaged(known, j))


def least_gain(claim: FittedHypothesis, of_first: float = MIN_GAIN_OF_NAMED) -> float:
    """Least log Bayes factor over calm water that a claim must have in fitted and held-out runs together."""
    return of_first + MIN_GAIN_OF_SECOND * (len(claim.names) - 1)


def _last_effect_helps(
    question: Question,
    tried: SearchResult,
    claim: FittedHypothesis,
    held_out: float,
    claims: Sequence[FittedHypothesis],
) -> bool:
    """Whether effects say more in fitted and held-out runs together than the best claim with one less, or no gusts."""
    by_evidence = sorted(claims, key=lambda j: j.evidence)
    fewer = {len(j.names): j for j in by_evidence if is_simpler(j, claim)}  # the best of each size
    others = [j.evidence + _held_out_evidence(question, tried, j) for j in fewer.values()]
    return claim.evidence + held_out > max(others, default=-np.inf) + (MIN_GAIN_OF_SECOND if others else 0.0)


def _about_own_states(data_set: WhitenedDataSet, claim: FittedHypothesis) -> tuple[WhitenedDataSet, FittedHypothesis]:
    """The runs about a claim's own states, and the claim there, the course of gusts integrated out.

    Strong gusts explain what a fit without them would lay on the mean wind, or on what acts beside it.

    Returns:
        The runs; the claim, at the process noise that takes its gusts for a random force, as all that follows does.
    """
    if not claim.random:
        return at_rest(data_set, claim)
    if data_set.dynamics.particulars.is_model:
        return data_set, claim  # on ponds gusts are larger than the mean, and blow across it
    there, found = at_rest(data_set, claim, refined_with_gusts)
    loose = MarginalLikelihood(there).evaluate(found.hypothesis, around=found.best[0])
    return there, replace(found, best=loose.best)


def _cost(question: Question, errors: Sequence[Mapping[str, float]]) -> float:
    return cost(errors, question.dynamics.particulars)


def error_after(question: Question, proofs: Sequence[Proof]) -> float:
    """Error of free runs of a repaired model."""
    return _cost(question, [p.rmse_after for p in proofs])


def unit_of_error(question: Question) -> str:
    """Unit of the cost in words."""
    one = counted_as_one(question.dynamics.particulars)
    return f"1 is {100 * one['pos']:.2g} % of L, {one['psi']:.2g} deg, {one['u']:.2g} m/s, {one['r']:.2g} deg/s"
