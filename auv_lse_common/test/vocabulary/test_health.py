from auv_lse_common.vocabulary.health import RECENT_S, NewProblems, Recent


def test_lasting_problem_is_new_once() -> None:
    new = NewProblems()
    assert new.of({"plan of 2 missing": "no plan of 2"}) == ["no plan of 2"]
    assert new.of({"plan of 2 missing": "no plan of 2 for 3 s"}) == []
    assert new.of({}) == []
    assert new.of({"plan of 2 missing": "again"}) == ["again"]


def test_problems_of_different_mates_are_separate() -> None:
    new = NewProblems()
    new.of({"plan of 2 missing": "team: no plan of vehicle 2"})
    assert new.of({"plan of 2 missing": "team: ...", "plan of 3 missing": "team: no plan of vehicle 3"}) == [
        "team: no plan of vehicle 3"
    ]


def test_old_counts_are_not_recent() -> None:
    recent = Recent()
    assert recent.of(0.0, {"jump": 0}) == {}
    assert recent.of(10.0, {"jump": 1, "late": 2}) == {"jump": 1, "late": 2}
    assert recent.of(60.0, {"jump": 4, "late": 2}) == {"jump": 4, "late": 2}
    assert recent.of(10.0 + RECENT_S + 1.0, {"jump": 4, "late": 2}) == {"jump": 3}
    assert recent.of(61.0 + RECENT_S, {"jump": 4, "late": 2}) == {}
    assert recent.of(62.0 + RECENT_S, {"jump": 1, "late": 2}) == {"jump": 1}, "counted from 0 again"
    assert recent.of(5.0, {"jump": 1, "late": 2}) == {}, "the clock was set back"
