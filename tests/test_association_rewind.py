import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.association.contract import ReportScan
from trackfield.association.rewind import Window, advance
from trackfield.errors import InputError


def scan(t_s, numbers) -> ReportScan:
    n = len(numbers)
    return ReportScan(
        float(t_s), np.zeros((n, 2)), np.zeros((n, 3)), np.array(sorted(numbers), dtype=np.int32)
    )


def remember(state, one, age):
    """Make a state that tells all that a step has been told, in order."""
    return (*state, (one.t_s, tuple(sorted(one.number.tolist())), age))


@given(
    st.lists(
        st.lists(st.tuples(st.integers(0, 999), st.integers(0, 6)), max_size=4),
        min_size=1,
        max_size=8,
    ),
    st.integers(0, 5),
    st.integers(0, 5),
)
def test_a_window_is_as_if_all_that_came_in_time_had_been_there(arrivals, length, unsettled):
    # Scan k has reports (number, delay); what comes within the window belongs to it.
    window, dropped = Window((), ()), 0
    for k in range(len(arrivals)):
        late = [
            scan(j, [number])
            for j in range(k)
            for number, delay in arrivals[j]
            if j + delay == k and delay > 0
        ]
        now = [number for number, delay in arrivals[k] if delay == 0]
        found = advance(
            window, scan(k, now), remember, late=late, length=length, unsettled=unsettled
        )
        window, dropped = found.window, dropped + found.dropped
        assert len(window.kept) == min(length, k + 1)
        assert sum(found.late_by_age) + found.dropped == len(late)
    last = len(arrivals) - 1
    expected = [
        sorted(
            number
            for number, delay in reports
            if delay == 0 or (delay <= length and k + delay <= last)
        )
        for k, reports in enumerate(arrivals)
    ]
    assert [list(numbers) for _, numbers, _ in window.state] == expected
    due = sum(d > length and k + d <= last for k, r in enumerate(arrivals) for _, d in r)
    assert dropped == due


def test_what_age_changes_is_told_again():
    window = Window((), ())
    for k in range(6):
        found = advance(window, scan(k, [k]), remember, length=4, unsettled=2)
        window = found.window
    assert [age for _, _, age in window.state] == [2, 2, 2, 2, 1, 0]
    assert found.replayed == 2


def test_an_untouched_window_is_not_replayed():
    first = advance(Window((), ()), scan(0, [1]), remember).window
    second = advance(first, scan(1, [2]), remember, late=[scan(0.5, [3])])
    assert (second.replayed, second.dropped) == (0, 1)
    assert second.window.kept[1].before is first.state


def test_time_goes_on():
    window = advance(Window((), ()), scan(1, []), remember).window
    assert window.newest_s == 1.0
    assert Window((), ()).newest_s == -math.inf
    with pytest.raises(InputError, match="order of time"):
        advance(window, scan(1, []), remember)
