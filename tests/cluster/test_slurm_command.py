"""Commands that run as one SLURM job, with programs that answer as those of SLURM do."""

import argparse
import io
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rtui.cli import main
from s2rtui.cli.command_parser import build_parser

pytest.importorskip("dask_jobqueue")
from s2rtools.nightly.command import command_arguments as nightly_arguments
from s2rtools.precompute.executors import slurm_command
from s2rtools.precompute.executors.slurm_command import run_command
from s2rtools.precompute.executors.slurm_settings import read_settings
from s2rtools.training.command import command_arguments as train_arguments

_SBATCH = """
for word in "$@"; do
    case $word in
        --output=*) out=$(echo "${word#*=}" | sed s/%j/7/) ;;
        --error=*) err=$(echo "${word#*=}" | sed s/%j/7/) ;;
    esac
done
cat > FOLDER/script
sh FOLDER/script > "$out" 2> "$err"
echo $? > FOLDER/status
echo 7
"""
_SCONTROL = """
count=$(cat FOLDER/count 2> /dev/null || echo 0)
echo $((count + 1)) > FOLDER/count
case $count in
    0) echo "JobId=7 JobState=PENDING Reason=LoadedData ExitCode=0:0 ReqNodeList=(null)" ;;
    1) echo "JobId=7 JobState=RUNNING Reason=None ExitCode=0:0 ReqNodeList=(null) NodeList=n1" ;;
    *) status=$(cat FOLDER/status)
       echo "JobId=7 JobState=FINAL Reason=BECAUSE DerivedExitCode=0:0 ExitCode=$status:0" ;;
esac
"""
_PYTHON = 'echo "$@"; echo "threads $OMP_NUM_THREADS, $SITE" >&2; exit STATUS'
_SETTINGS = """
[slurm]
jobs = 9
cores = 3
walltime = "00:10:00"
python = "{folder}/python"
prologue = ["export SITE=here"]
log_folder = "{folder}/logs"
"""


class Slurm:
    """Programs of SLURM; the job of a test runs at once and ends with some state."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.file = folder / "slurm.toml"
        self.file.write_text(_SETTINGS.format(folder=folder))
        monkeypatch.setenv("PATH", f"{folder}/bin:/usr/bin:/bin")
        monkeypatch.setattr(slurm_command, "_POLL_SECONDS", 0.001)
        (folder / "bin").mkdir()
        self.ends()

    def ends(self, status: int = 0, state: str = "COMPLETED", reason: str = "None") -> None:
        """Let the job end with an exit status, in a state of SLURM."""
        self.write("bin/sbatch", _SBATCH)
        self.write("bin/scontrol", _SCONTROL.replace("FINAL", state).replace("BECAUSE", reason))
        self.write("bin/scancel", "echo $@ > FOLDER/cancelled")
        self.write("python", _PYTHON.replace("STATUS", str(status)))

    def write(self, name: str, script: str) -> None:
        path = self.folder / name
        path.write_text("#!/bin/sh\n" + script.replace("FOLDER", str(self.folder)))
        path.chmod(0o755)

    def run(self, lines: list[str]) -> tuple[int, str, str]:
        """Exit code, output and errors of a job that runs `s2r train`."""
        out, err = io.StringIO(), io.StringIO()
        words, settings = ["train", "--name=a b"], read_settings(self.file)
        code = run_command(settings, "s2r-train", words, lines.append, (out, err))
        return code, out.getvalue(), err.getvalue()


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Slurm:
    return Slurm(tmp_path, monkeypatch)


@pytest.mark.parametrize(("status", "state"), [(0, "COMPLETED"), (1, "FAILED"), (3, "FAILED")])
def test_the_output_and_the_exit_code_are_those_of_the_job(slurm, status, state):
    slurm.ends(status, state)
    lines: list[str] = []
    code, out, err = slurm.run(lines)
    assert (code, out) == (status, "-P -m s2rtui train --name=a b\n")
    assert err == "threads 3, here\n"
    logs = slurm.folder / "logs"
    assert lines == [
        f"job 7 submitted; its output goes to {logs}/s2r-train-7.out and s2r-train-7.err",
        "job 7 waits (LoadedData)",
        "job 7 runs on n1",
    ]
    assert not (slurm.folder / "cancelled").exists()


@pytest.mark.parametrize(
    ("status", "state", "reason", "message"),
    [
        (0, "TIMEOUT", "TimeLimit", r"job 7 was ended \(TIMEOUT, TimeLimit\); see .*-7.err"),
        (9, "OUT_OF_MEMORY", "OutOfMemory", r"job 7 was ended \(OUT_OF_MEMORY, OutOfMemory\)"),
        (127, "FAILED", "NonZeroExitCode", r"job 7: its script failed with 127; see .*-7.err"),
    ],
)
def test_a_job_that_does_not_end_by_itself_is_told(slurm, status, state, reason, message):
    slurm.ends(status, state, reason)
    with pytest.raises(RequestError, match=message):
        slurm.run([])


def test_a_refused_job_is_told_with_the_words_of_sbatch(slurm):
    slurm.write("bin/sbatch", "echo 'sbatch: error: Invalid account' >&2; exit 1")
    with pytest.raises(RequestError) as error:
        slurm.run([])
    expected = f"{slurm.file}: no job could be submitted (sbatch: error: Invalid account)"
    assert str(error.value) == expected


def test_an_interrupt_cancels_the_job(slurm):
    def report_line(line: str) -> None:
        if "runs on" in line:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_command(read_settings(slurm.file), "s2r-train", [], report_line)
    assert (slurm.folder / "cancelled").read_text() == "7\n"


def test_a_link_to_a_configuration_keeps_its_folder(tmp_path):
    """The paths in a configuration are relative to the link, not to its target."""
    (tmp_path / "live").mkdir()
    link = tmp_path / "live" / "nightly.toml"
    link.symlink_to(tmp_path / "gates.toml")
    assert parsed(nightly_arguments(parsed(["nightly", str(link)]))).config == link


def test_a_wrong_date_to_withdraw_is_refused_before_the_job():
    options = parsed(["nightly", "--withdraw", "2026-99-99", "n.toml"])
    with pytest.raises(RequestError, match="--withdraw 2026-99-99"):
        nightly_arguments(options)


def test_a_job_that_slurm_has_forgotten_is_told(slurm):
    slurm.write(
        "bin/scontrol", "echo 'slurm_load_jobs error: Invalid job id specified' >&2; exit 1"
    )
    with pytest.raises(RequestError, match=r"does not show job 7 \(slurm_load_jobs error: Inv"):
        slurm.run([])
    assert not (slurm.folder / "cancelled").exists()


def parsed(words: list[str]) -> argparse.Namespace:
    return build_parser([words[0]]).parse_args(words)


_IN_JOB = {"cluster", "show_job_script", "debug", "store", "config", "night", "parser"}
"""Options that a job does not get as they were given."""


@pytest.mark.parametrize(
    "given",
    [
        ["--recipe", "vanilla"],
        ["--recipe", "finetune", "--from=-a", "--translator", "t", "--force", "--name", "n",
         "--arch", "resposenet", "--minutes", "1.5", "--steps", "7", "--seed", "3"],
    ],
)  # fmt: skip
def test_a_job_trains_with_all_options(given):
    options = parsed(["train", "--store", "s.s2r", *given])
    in_job = parsed(train_arguments(options, "/nodes/s.s2r"))
    assert in_job.store == Path("/nodes/s.s2r")
    for name in vars(options).keys() - _IN_JOB:
        assert getattr(in_job, name) == getattr(options, name), name


def test_a_job_measures_the_named_night_with_all_options(tmp_path):
    for given in (["--night", "2026-11-21", "--far-night", "--json"], ["--withdraw", "2026-11-20"]):
        options = parsed(["nightly", *given, "n.toml"])
        in_job = parsed(nightly_arguments(options))
        assert in_job.config == Path("n.toml").absolute()
        for name in vars(options).keys() - (_IN_JOB - {"night"}):
            assert getattr(in_job, name) == getattr(options, name), name
    assert parsed(nightly_arguments(parsed(["nightly", "n.toml"]))).night is not None


def test_train_submits_a_job(slurm, store_copy, capsys, s2r):
    command = ["train", "--recipe", "vanilla", "--name", "new", "--store", str(store_copy)]
    script = s2r(*command, "--cluster", slurm.file, "--show-job-script").printed
    assert not (slurm.folder / "script").exists()
    assert main([*command, "--cluster", str(slurm.file)]) == 0
    assert (slurm.folder / "script").read_text() == script
    assert "#SBATCH --cpus-per-task=3" in script.splitlines()
    printed = capsys.readouterr()
    assert f"train --store={store_copy} --recipe=vanilla --name=new" in printed.out
    assert "job 7 runs on n1" in printed.err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--minutes", "10", "--cluster", "FILE"], "at least the walltime 00:10:00 of"),
        (["--name", "vanilla", "--cluster", "FILE"], "--name vanilla: already in"),
        (["--cluster", "local:2"], "--cluster local:2: is for `s2r precompute`"),
        (["--cluster", ""], "--cluster: names nothing"),
        (["--show-job-script"], "--show-job-script: needs --cluster FILE"),
    ],
)
def test_wrong_requests_submit_nothing(slurm, store_copy, s2r, given, message):
    words = [word.replace("FILE", str(slurm.file)) for word in given]
    command = ["train", "--recipe", "vanilla", "--name", "new", "--store", str(store_copy)]
    s2r(*command, *words).assert_refused(message)
    assert not (slurm.folder / "script").exists()
