import pytest

from vig.io.progress import Meter


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the clock shows."""
    seconds = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: seconds[0])
    return seconds


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().err.splitlines()


def test_a_log_gets_a_line_for_each_tenth(capsys: pytest.CaptureFixture[str], clock: list[float]) -> None:
    with Meter(200, 40) as meter:
        for _ in range(160):
            clock[0] += 0.1
            meter.advance(1)
    assert lines(capsys) == [
        f"{n} of 200 samples, 10.0/s, 0:{(200 - n) // 10:02d} left" for n in range(60, 201, 20)
    ]


def test_what_is_done_at_once_has_no_rate(capsys: pytest.CaptureFixture[str], clock: list[float]) -> None:
    """Two networks trained side by side for 60 s, of 100 steps each, then steps one by one."""
    with Meter(400, 0, unit="steps") as meter:
        meter.advance(40)  # there from an earlier run
        clock[0] += 60
        for _ in range(2):
            meter.advance(100)
            clock[0] += 1e-5
        clock[0] += 2
        meter.advance(40)
    assert lines(capsys) == [
        "40 of 400 steps",
        "140 of 400 steps, 1.7/s, 2:36 left",
        "240 of 400 steps, 3.3/s, 0:48 left",
        "280 of 400 steps, 3.9/s, 0:31 left",
    ]


def test_a_slow_run_says_that_it_lives(capsys: pytest.CaptureFixture[str], clock: list[float]) -> None:
    with Meter(1000, 0) as meter:
        for _ in range(3):
            clock[0] += 16
            meter.advance(1)
        assert lines(capsys) == ["2 of 1000 samples, 16.0 s each, 4:26:08 left"]
    assert lines(capsys) == ["3 of 1000 samples, 16.0 s each, 4:25:52 left"]


def test_batches_do_not_pass_the_total_and_nothing_is_said_when_not_wanted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Meter(20, 0, unit="pictures") as meter:
        meter.advance(16)
        meter.advance(16)
    said = capsys.readouterr().err
    assert "20 of 20 pictures" in said and "32" not in said and "-" not in said
    with Meter(10, 0, show=False) as meter:
        meter.advance(10)
    assert lines(capsys) == []


def test_the_time_left_is_not_that_of_the_runs_beginning(
    capsys: pytest.CaptureFixture[str], clock: list[float]
) -> None:
    """Twenty seconds until the first samples come, then ten a second."""
    with Meter(1000, 0) as meter:
        clock[0] += 20
        meter.advance(10)
        for _ in range(9):
            clock[0] += 1
            meter.advance(10)
    assert lines(capsys) == ["100 of 1000 samples, 10.0/s, 1:30 left"]
