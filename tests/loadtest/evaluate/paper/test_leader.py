"""A leader file that cannot be used gets one line that names the row and the problem."""

from pathlib import Path

import numpy as np
import pytest

from headway_loadtest.evaluate.paper.leader import HEAD_START_M, Leader, LeaderFileError, read_leader


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def spoiled(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_a_drive_is_read_and_put_at_the_head_start(leader: Leader, leader_csv: Path) -> None:
    read = read_leader(leader_csv)
    assert read.x_m[0] == HEAD_START_M
    np.testing.assert_allclose(read.x_m, leader.x_m, atol=1e-5)
    np.testing.assert_allclose(read.v_mps, leader.v_mps, atol=1e-5)


def test_columns_are_found_by_name(leader_csv: Path) -> None:
    rows = [",".join([f"{k}", *reversed(row.split(","))]) for k, row in enumerate(lines(leader_csv)[1:])]
    read = read_leader(spoiled(leader_csv, ["row,v_mps,x_m,t_s", *rows]))
    assert read.v_mps[0] == pytest.approx(float(rows[0].split(",")[1]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda rows: ["t_s,x_m,speed", *rows[1:]], "row 1: no column v_mps"),
        (lambda rows: ["t_s,v_mps", *[",".join(row.split(",")[::2]) for row in rows[1:]]], "row 1: no column x_m"),
        (
            lambda rows: [*rows[:7], rows[7].rsplit(",", 1)[0] + ",fast", *rows[8:]],
            "row 8: v_mps must be a number, not 'f",
        ),
        (
            lambda rows: [*rows[:7], rows[7].rsplit(",", 1)[0] + ",nan", *rows[8:]],
            "row 8: v_mps must be a number, not 'nan'",
        ),
        (lambda rows: [*rows[:7], rows[7].rsplit(",", 1)[0], *rows[8:]], "row 8: v_mps must be a number, not ''"),
        (lambda rows: rows[:100] + rows[101:] + ["60.0,0,0"], "row 101: t_s goes from 9.8 to 10"),
        (lambda rows: [rows[0], *reversed(rows[1:])], "row 3: t_s goes from 59.9 to 59.8"),
        (lambda rows: rows[:100], "99 samples are too short"),
        (lambda rows: rows[:1], "0 samples are too short"),
        (lambda rows: rows[1:], "row 1: no column t_s, x_m, v_mps"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(leader_csv: Path, spoil, message: str) -> None:
    with pytest.raises(LeaderFileError) as caught:
        read_leader(spoiled(leader_csv, spoil(lines(leader_csv))))
    assert message in str(caught.value)
    assert str(leader_csv) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["absent.csv", "."])
def test_a_file_that_cannot_be_opened_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(LeaderFileError, match="give a CSV with the columns t_s, x_m, v_mps"):
        read_leader(tmp_path / name)


def test_bytes_that_are_no_text_are_named(tmp_path: Path) -> None:
    path = tmp_path / "leader.csv"
    path.write_bytes(b"\xff\xfe\x00\x81" * 50)
    with pytest.raises(LeaderFileError, match=r"leader\.csv: "):
        read_leader(path)
