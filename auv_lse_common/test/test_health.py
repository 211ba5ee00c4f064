from auv_lse_common.health import NewProblems


def test_a_problem_is_new_once_for_as_long_as_it_lasts() -> None:
    new = NewProblems()
    assert new.of({"plan of 2 missing": "no plan of 2"}) == ["no plan of 2"]
    assert new.of({"plan of 2 missing": "no plan of 2 for 3 s"}) == []
    assert new.of({}) == []
    assert new.of({"plan of 2 missing": "again"}) == ["again"]


def test_a_problem_of_one_mate_does_not_hide_that_of_another() -> None:
    new = NewProblems()
    new.of({"plan of 2 missing": "team: no plan of vehicle 2"})
    assert new.of({"plan of 2 missing": "team: ...", "plan of 3 missing": "team: no plan of vehicle 3"}) == [
        "team: no plan of vehicle 3"
    ]
