"""How the program prints: within the terminal's width, no word broken; and what `compensate` says that it wrote."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.calibration.text import flowed
from tests.support.bags import pose_stamped, wrench_stamped, write_bag
from tests.support.recordings import PANDA, PAPER, beside_its_doubt, run, run_quietly, rz

Capture = pytest.CaptureFixture[str]
VERBS = (
    "info",
    "plan",
    "calibrate",
    "diagnose",
    "compensate",
    "verify",
    "weigh",
    "show",
    "diff",
    "simulate",
    "demo",
    "export",
    "devices",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two calibrations, two recordings and a bag, under short names."""
    folder = tmp_path_factory.mktemp("out")
    (folder / "panda.csv").write_bytes(PANDA.read_bytes())
    (folder / "paper.csv").write_bytes(PAPER.read_bytes())
    cw.calibrate(cw.read(PANDA)).save(folder / "panda.json")
    cw.calibrate(cw.read(PAPER), "paper").save(folder / "paper.json")
    R = np.array([rz(0.05 * k) for k in range(20)])
    messages = [wrench_stamped(0.1 * k, np.ones(6)) for k in range(20)]
    messages += [pose_stamped(0.1 * k, R[k], np.zeros(3)) for k in range(20)]
    write_bag(folder / "run.mcap", messages)
    return folder


def on_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, folder: Path, columns: int, *arguments: str
) -> list[str]:
    """The lines that the program shows on a terminal of so many columns, stdout before stderr."""
    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("COLUMNS", str(columns))
        patch.setattr(sys.stdout, "isatty", lambda: True)
        patch.setattr(sys.stderr, "isatty", lambda: True)
        assert run_quietly(arguments) in (0, 1)
    shown = capsys.readouterr()
    return (shown.out + shown.err).splitlines()


OUTPUTS = {
    "calibrate": ("calibrate", "panda.csv", "--require-force", "1e-6"),
    "calibrate, weak": ("calibrate", "paper.csv", "--model", "paper"),
    "show": ("show", "panda.json"),
    "verify": ("verify", "paper.csv", "-c", "panda.json"),
    "weigh": ("weigh", "panda.csv", "-c", "panda.json"),
    "diff": ("diff", "panda.json", "paper.json"),
    "info": ("info", "run.mcap"),
    "info of a table": ("info", "panda.csv"),
    "plan": ("plan", "-n", "3"),
    "plan, seven joints": ("plan", "-n", "3", "--robot", "iiwa7", "--from", "paper.csv", "--force", "-o", "plan.csv"),
    "diagnose": ("diagnose", "panda.csv", "--orientation", "rpy:qx,qy,qz", "--inverse-orientation"),
    "compensate": (
        "compensate",
        "run.mcap",
        "-c",
        "panda.json",
        "--force",
        "-o",
        "out.mcap",
        "--contact",
        "--delay",
        "0.01",
    ),
    "simulate": ("simulate", "--force", "-o", "sim.csv", "--set", "sensor.bias=1"),
    "export, list": ("export", "--list"),
}
ALL_BUT_HELP = pytest.mark.parametrize("arguments", OUTPUTS.values(), ids=OUTPUTS)


@pytest.mark.slow
@ALL_BUT_HELP
def test_nothing_is_wider_than_eighty_columns_and_no_word_is_broken(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, folder: Path, arguments: tuple[str, ...]
) -> None:
    if arguments[0] == "simulate":
        pytest.importorskip("mujoco")
    narrow, wide = (
        on_terminal(monkeypatch, capsys, folder, 80, *arguments),
        on_terminal(monkeypatch, capsys, folder, 120, *arguments),
    )
    assert max(map(len, narrow)) <= 80
    assert " ".join(" ".join(narrow).split()) == " ".join(" ".join(wide).split())


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [OUTPUTS["calibrate, weak"], OUTPUTS["verify"]], ids=["calibrate", "verify"])
def test_sentences_flow_to_the_width_of_the_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture, folder: Path, arguments: tuple[str, ...]
) -> None:
    for columns in (60, 200):
        sentences = [
            line
            for line in on_terminal(monkeypatch, capsys, folder, columns, *arguments)
            if "  " not in line.strip()[9:]
        ]
        assert min(columns, 120) - 20 < max(map(len, sentences)) <= min(columns, 120)


@pytest.mark.parametrize("verb", VERBS)
def test_help_breaks_no_word(monkeypatch: pytest.MonkeyPatch, capsys: Capture, folder: Path, verb: str) -> None:
    narrow, wide = (
        on_terminal(monkeypatch, capsys, folder, 80, verb, "--help"),
        on_terminal(monkeypatch, capsys, folder, 120, verb, "--help"),
    )
    assert max(map(len, narrow)) <= 80
    assert " ".join(" ".join(narrow).split()) == " ".join(" ".join(wide).split())


def test_without_a_terminal_a_sentence_is_a_line(folder: Path, capsys: Capture) -> None:
    lines = run(capsys, "verify", PAPER, "-c", folder / "panda.json").out.splitlines()
    assert lines[-1].startswith("FAILED  the residual is more than the calibration's covariance and noise explain (")
    assert lines[-1].endswith(")")


def test_flowing_text_keeps_tables_bullets_and_paths() -> None:
    path = "/".join(["folder"] * 12)
    text = f"Verdict  good and so on\n- to be done at once\n  a table   of three   columns\n  {path} is long"
    assert flowed(text, 16).splitlines() == [
        "Verdict  good",
        "         and so",
        "         on",
        "- to be done at",
        "  once",
        "  a table   of three   columns",
        path,
        "  is long",
    ]


@pytest.mark.parametrize("before", [None, b"an older file"])
@pytest.mark.parametrize("name", ["out.csv", "out.mcap"])
def test_compensate_says_what_it_wrote_and_replaces_what_was_there_with_force(
    folder: Path, tmp_path: Path, capsys: Capture, name: str, before: bytes | None
) -> None:
    command = ("compensate", folder / "run.mcap", "-c", folder / "panda.json", "-o", tmp_path / name)
    if before is not None:
        (tmp_path / name).write_bytes(before)
        assert run(capsys, *command).complaint == (
            f"{tmp_path / name}: found a file there already, expected a new name: name another, or replace it with "
            "--force"
        )
        assert (tmp_path / name).read_bytes() == before
    done = run(capsys, *command, *([] if before is None else ["--force"]))
    rows = {"out.csv": "20 rows", "out.mcap": "20 messages of /wrench/contact"}[name]
    note = "Note: the calibration does not name its base: taken to be base (--base-frame names it)\n"
    wrote = f"Wrote the contact wrenches, {rows}, to {tmp_path / name}\n"
    assert (done.status, done.out, beside_its_doubt(done.err)) == (0, wrote, note)
    assert (tmp_path / name).read_bytes() != before
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["out.csv", "out.mcap"])
def test_a_folder_that_is_there_is_never_replaced(folder: Path, tmp_path: Path, capsys: Capture, name: str) -> None:
    (tmp_path / name).mkdir()
    done = run(capsys, "compensate", folder / "run.mcap", "-c", folder / "panda.json", "-o", tmp_path / name)
    assert done.complaint.startswith(f"{tmp_path / name}: found a ")
    assert (tmp_path / name).is_dir()


def test_why_a_calibration_is_not_good_is_repeated_where_it_is_used(tmp_path: Path, capsys: Capture) -> None:
    """The first reason of the worst kind, in short; of a good one nothing."""
    good = replace(cw.calibrate(cw.read(PAPER), "mount"), findings=())
    good.save(tmp_path / "good.json")
    doubts = (
        Finding(Kind.CREEP, Severity.WARNING, "it creeps"),
        Finding.doubtful(Kind.CABLE, "a cable pulls: route it anew"),
        Finding.doubtful(Kind.GAIN, "a gain is off: calibrate the sensor"),
    )
    replace(good, findings=doubts).save(tmp_path / "doubtful.json")
    weak = Finding.weak(Kind.UNCERTAIN_PARAMETER, "the weight is known to 20 %: record more poses")
    replace(good, findings=(*doubts, weak)).save(tmp_path / "weak.json")
    for name, said in (
        ("good", ""),
        ("doubtful", "the calibration is doubtful: a cable pulls"),
        ("weak", "the calibration is weak: the weight is known to 20 %"),
    ):
        path = tmp_path / f"{name}.json"
        done = run(capsys, "compensate", PAPER, "-c", path)
        assert done.err == (f"Note: {said}\n" if said else "")


def test_without_an_output_the_contact_wrenches_go_to_stdout(folder: Path, capsys: Capture) -> None:
    arguments = ("compensate", folder / "panda.csv", "-c", folder / "panda.json")
    done = run(capsys, *arguments)
    assert (done.status, beside_its_doubt(done.err)) == (0, "")
    assert len(done.out.splitlines()) == 18
    assert run(capsys, *arguments, "-o", "-") == done


@pytest.mark.parametrize("verb", ["info {} --json", "calibrate {} --json", "calibrate {} -o -", "live --from {} {}"])
def test_json_of_a_file_whose_name_controls_a_terminal_is_visible(tmp_path: Path, capsys: Capture, verb: str) -> None:
    """U+009B begins an order to a terminal, U+0085 a line; JSON says the same by its escapes."""
    path = tmp_path / "a\x85b\x9b31mc.csv"
    header, *rows = [line for line in PANDA.read_text().splitlines() if not line.startswith("#")]
    path.write_text("\n".join([f"t,{header}", *(f"{k},{row}" for k, row in enumerate(rows)), ""]))
    cw.calibrate(cw.read(PANDA)).save(tmp_path / "tool.json")
    session = f"-c {tmp_path}/tool.json --no-page --speed 0 --events"
    done = run(
        capsys, *(str(path) if each == "{}" else each for each in verb.replace("{} {}", f"{{}} {session}").split())
    )
    assert done.status == 0
    assert not {letter for letter in done.out if 0x7F <= ord(letter) < 0xA0}
    texts = done.out.splitlines() if "--from" in verb else [done.out]
    assert path.name in "".join(json.dumps(json.loads(text), ensure_ascii=False) for text in texts)
