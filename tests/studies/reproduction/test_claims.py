"""Claims of papers as data: every rule judges where the answer is known; a wrong yaml ends in one clear line."""

import pytest

import studies
from manoeuvre_nn.core.errors import InputError
from studies.reproduction.claims import read_claims
from studies.reproduction.paper import paper_folders, read_paper
from studies.reproduction.template import filled


@pytest.fixture
def said(monkeypatch, tmp_path):
    """``said("- where: ...")`` gives the claims of a chapter with these entries."""

    def write(entries, limits="{}"):
        folder = tmp_path / f"paper{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        (folder / "study.yaml").write_text("title: t\nsource: s\nchapters: {}")
        (folder / "claims.yaml").write_text(f"limits: {limits}\nchapters:\n  1:\n{entries}")
        monkeypatch.setattr(studies, "__path__", [*studies.__path__, str(tmp_path)])
        return read_claims(folder.name, "1")

    return write


def verdicts(claims, **quantities):
    return [claim.verdict for claim in claims.beside(quantities)]


HEAD = "  - {where: Table 1, what: x, "


@pytest.mark.parametrize(
    "rule, value, verdict",
    [
        ("paper: 2.0, ours: '{x}', within: 0.5", 2.4, "holds"),
        ("paper: 2.0, ours: '{x}', within: 1e-1", 2.4, "does not hold"),
        ("paper: 2.0, ours: '{x}', within: 0.1, same_sign: true", 2.4, "holds in direction"),
        ("paper: 2.0, ours: '{x}', within: 0.1, same_sign: true", -2.4, "does not hold"),
        ("paper: 2.0, ours: '{x}', relative: 0.25", 2.4, "holds"),
        ("paper: 2.0, ours: '{x}', within: 0.1, relative: 0.25", 2.4, "holds"),
        ("paper: 2.0, ours: '{x}', within: 1.0", float("nan"), "does not hold"),
        ("paper: 2.0, ours: '{x}', factor: 10", 19.0, "holds"),
        ("paper: 2.0, ours: '{x}', factor: 10", 21.0, "does not hold"),
        ("paper: good, ours: '{x}', holds: <= 0.1", 0.1, "holds"),
        ("paper: good, ours: '{x}', holds: < 0.1, in_direction: <= 0.3", 0.1, "holds in direction"),
        ("paper: good, ours: '{x}', holds: < 0.1, in_direction: <= 1/3", 0.4, "does not hold"),
        ("paper: good, ours: '{x}', holds: '<= {limit}'", 0.5, "holds"),
        ("paper: good, ours: '{x}', holds: '> 0.1 and < 1'", 1.0, "does not hold"),
        ("paper: good, ours: 'off by {x:.1f}', of: x, holds: '== 0.5'", 0.5, "holds"),
        ("paper: good, ours: text, of: x, holds: true", True, "holds"),
        ("paper: good, ours: text, of: x, holds: true", False, "does not hold"),
        ("paper: good, ours: text, of: x, in_direction: '> 1'", 2.0, "holds in direction"),
        ("paper: good, share: x", 0.75, "holds"),
        ("paper: good, share: x", 0.6, "holds in direction"),
        ("paper: good, share: x", 0.5, "does not hold"),
        ("paper: good, share: x, chance: 1/5", 0.4, "holds in direction"),
        ("paper: good, share: x, chance: 0.21", 0.4, "does not hold"),
        ("paper: 4.0, starts: x", [1.0, 4.0, 2.0], "holds"),
        ("paper: 11.0, starts: x", [1.0, 4.0, 2.0], "holds in direction"),
        ("paper: 0.4, starts: x", [1.0, 4.0, 2.0], "holds in direction"),
        ("paper: 13.0, starts: x", [1.0, 4.0, 2.0], "does not hold"),
        ("paper: 0.3, starts: x", [1.0, 4.0, 2.0], "does not hold"),
        ("paper: drawn, ours: '{x}', verdict: not comparable", 1.0, "not comparable"),
    ],
)
def test_every_rule_gives_its_verdict(said, rule, value, verdict):
    assert verdicts(said(f"{HEAD}{rule}}}", "{limit: 0.5}"), x=value) == [verdict]


def test_numbers_stay_numbers_and_texts_are_filled_in(said):
    (claim,) = said(f"{HEAD}paper: 2.0, ours: '{{x}}', within: 1, unit: m, note: 'of {{n}}', why: bad}}").beside({
        "x": 2.5,
        "n": 3,
    })
    assert (claim.where, claim.what, claim.paper, claim.ours, claim.unit, claim.why) == (
        "Table 1", "x", 2.0, 2.5, "m", "of 3",
    )  # fmt: skip


def test_why_is_said_only_where_a_claim_does_not_hold_and_a_note_always(said):
    entry = f"{HEAD}paper: 2.0, ours: '{{x}}', within: 1, note: a, why: b}}"
    assert [said(entry).beside({"x": x})[0].why for x in (2.0, 5.0)] == ["a", "a; b"]


def test_a_share_is_told_with_its_chance_and_a_distribution_with_its_range(said):
    (share,) = said(f"{HEAD}paper: good, share: x, chance: 1/4}}").beside({"x": 0.5})
    assert share.ours == "true for 0.50 of the starts (chance 0.25)"
    (median,) = said(f"{HEAD}paper: 1.0, starts: x, note: tanh}}").beside({"x": [1.0, 4.0, 2.0]})
    assert median.ours == 2.0 and median.why == "3 starts: 1 to 4; tanh"


def test_values_are_one_claim_each_with_a_reason_for_some_of_them(said):
    entry = "  - {where: T, of: table, values: {Y_v: 1.0, Y_r - m: 1e-1}, within: 0.01, why: {Y_v: slip}}"
    first, second = said(entry).beside({"table": {"Y_v": 2.0, "Y_r - m": 0.1}})
    assert (first.what, first.verdict, first.why) == ("Y_v", "does not hold", "slip")
    assert (second.what, second.paper, second.verdict, second.why) == ("Y_r - m", 0.1, "holds", "")


def test_each_is_one_claim_for_every_item(said):
    claims = said("  - {where: T, each: runs, what: 'dev, {label}', paper: ok, ours: '{dev[zz]}', holds: < 1}")
    items = [{"label": "a", "dev": {"zz": 0.5}}, {"label": "b", "dev": {"zz": 2.0}}]
    assert [(c.what, c.ours, c.verdict) for c in claims.beside({"runs": items})] == [
        ("dev, a", 0.5, "holds"), ("dev, b", 2.0, "does not hold"),
    ]  # fmt: skip


def test_a_part_of_the_claims_can_be_asked_for(said):
    claims = said(
        f"{HEAD}paper: a, ours: b, verdict: holds}}\n  - {{where: Fig 2, what: y, paper: a, ours: b, verdict: holds}}"
    )
    assert [c.what for c in claims.at("Fig").beside({})] == ["y"]


@pytest.mark.parametrize(
    "entry, told",
    [
        ("paper: 1.0, ours: '{x}'}", "expected one rule"),
        ("paper: 1.0, ours: '{x}', within: 1, holds: < 1}", "expected one rule"),
        ("paper: 1.0, ours: '{x}', within: 1, share: x}", "expected one rule"),
        ("paper: 1.0, ours: '{x}', withn: 1}", "'withn' is unknown; choose from"),
        ("paper: 1.0, ours: '{x}', within: near}", "within: 'near': expected a number"),
        ("paper: 1.0, within: 1}", "ours is missing"),
        ("ours: a, verdict: holds}", "paper is missing"),
        ("paper: 1.0, ours: a, verdict: perhaps}", "verdict 'perhaps' is unknown"),
        ("of: t, values: 3, within: 1}", "values: expected name: number"),
        ("of: t, values: {a: b}, within: 1}", "a: 'b': expected a number"),
    ],
)
def test_a_wrong_entry_is_refused_in_one_line_before_anything_is_computed(said, entry, told):
    with pytest.raises(InputError) as refused:
        said(HEAD + entry)
    message = str(refused.value)
    assert told in message and "claims.yaml, chapter 1, claim 1 (Table 1)" in message and "\n" not in message


@pytest.mark.parametrize(
    "entry, told",
    [
        ("paper: 1.0, ours: '{y}', within: 1}", "there is no quantity 'y'"),
        ("paper: 1.0, ours: '{x[a]}', within: 1}", "'{x[a]}'"),
        ("paper: good, ours: '{x}', within: 1}", "paper is 'good': expected a number"),
        ("paper: good, ours: '{x}', holds: about 1}", "expected a bound such as <= 0.1, or true"),
        ("paper: good, ours: 'text', holds: < 1}", "what is judged is 'text': expected a number"),
    ],
)
def test_a_quantity_that_is_not_there_is_one_line(said, entry, told):
    with pytest.raises(InputError) as refused:
        said(HEAD + entry).beside({"x": 1.0})
    assert told in str(refused.value) and "chapter 1, claim 1" in str(refused.value)


@pytest.mark.parametrize("limits", ["{a: text}", "{a: true}"])
def test_limits_are_numbers(said, limits):
    with pytest.raises(InputError, match="limits: a is no number"):
        said(f"{HEAD}paper: a, ours: b, verdict: holds}}", limits)


def test_a_list_is_joined_and_a_number_alone_is_kept():
    assert filled("{x:.1f} L", {"x": [1.0, 2.0]}, "") == "1.0, 2.0 L"
    assert filled("{x:/.2g}", {"x": [0.1, 0.25]}, "") == "0.1/0.25"
    assert filled("{x}", {"x": 3.0}, "") == 3.0 and filled(2.0, {}, "") == 2.0


@pytest.mark.parametrize("paper", list(paper_folders()))
def test_every_chapter_has_its_claims(paper):
    for number in read_paper(paper).chapters:
        assert read_claims(paper, number).statements
    with pytest.raises(InputError, match="chapter 99 has no claims; there are: "):
        read_claims(paper, "99")
