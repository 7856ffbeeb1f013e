"""Exports: what other tools read of them, evo as the judge of its own files."""

import csv
import json
import subprocess
import sys
from importlib.metadata import entry_points
from zipfile import ZipFile

import numpy as np
import pytest

from vrbench.errors import ConfigError, DataError
from vrbench.exporting import export
from vrbench.metrics.as_evo import Question, compare
from vrbench.metrics.compared import NO_X
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.results.bundle import Bundle
from vrbench.results.export import FORMATS
from vrbench.results.export.evo import statistics
from vrbench.results.export.part import plain
from vrbench.results.tables import COLUMNS, read_rows
from vrbench.trajectory import read_tum_as_written

STEM = "replay.default.m1.r1.robot"
TABLE = "metrics/vrbench-1.csv"


@pytest.fixture(scope="module")
def exported(_run, tmp_path_factory):
    """Exports of a run by format, each made once."""
    made = {}

    def of(form):
        if form not in made:
            if form == "parquet":
                pytest.importorskip("pyarrow", reason="pip install 'vrbench[parquet]'")
            folder = tmp_path_factory.mktemp("exports") / form
            export(Bundle.open(_run), form, PROTOCOL, folder, lambda *_: None, pytest.fail)
            made[form] = folder
        return made[form]

    return of


def rmse_mm(run, point, repeat="1"):
    (row,) = [
        row
        for row in read_rows(run / TABLE)
        if (row.case, row.repeat, row.point, row.statistic) == ("replay", repeat, point, "rmse")
        and (row.metric, row.variant, row.band) == ("ape.translation.aligned", "main", "all")
    ]
    return row.value


@pytest.mark.parametrize("point", ["eye", "tcp"])
def test_tum_files_give_the_metric_s_number(exported, _run, point):
    folder = exported("tum")
    truth, estimate = (
        read_tum_as_written(folder / f"{STEM}.{point}.{kind}.tum") for kind in ("truth", "estimate")
    )
    answer = compare(truth, estimate, Question(False, True, None, 0.01))
    assert 1e3 * answer.statistics["rmse"] == pytest.approx(rmse_mm(_run, point), rel=1e-9)


def test_a_take_without_x_is_exported_as_it_can_be(run, tmp_path):
    record = json.loads((run / "run.json").read_text())
    record["takes"] = [take for take in record["takes"] if take["role"] == "scored"][:1]
    (run / "run.json").write_text(json.dumps(record))
    files = export(Bundle.open(run), "tum", PROTOCOL, tmp_path / "x", lambda *_: None, pytest.fail)
    assert [path.name for path in files] == [f"{STEM}.tcp.truth.tum", f"{STEM}.eye.estimate.tum"]
    for form in ("evo", "csv"):
        told = []
        with pytest.raises(DataError, match="nothing can be exported"):
            export(Bundle.open(run), form, PROTOCOL, tmp_path / form, lambda *_: None, told.append)
        assert told == [f"{STEM}: {NO_X}"]


def test_a_table_of_samples_tells_what_is_not_in_it(run, tmp_path):
    pytest.importorskip("pyarrow", reason="pip install 'vrbench[parquet]'")
    record = json.loads((run / "run.json").read_text())
    record["takes"] = [take for take in record["takes"] if take["role"] == "scored"][:1]
    (run / "run.json").write_text(json.dumps(record))
    told = []
    bundle, folder = Bundle.open(run), tmp_path / "x"
    files = export(bundle, "parquet", PROTOCOL, folder, lambda *_: None, told.append)
    assert [path.name for path in files] == ["metrics.parquet"]
    assert told == [f"{STEM}: {NO_X}"]


def test_evo_reads_its_results_and_finds_the_same_numbers(exported, _run):
    pytest.importorskip("evo")
    from evo.tools import file_interface

    found = file_interface.load_res_file(exported("evo") / f"{STEM}.eye.zip", True)
    assert 1e3 * found.stats["rmse"] == pytest.approx(rmse_mm(_run, "eye"), rel=1e-9)
    error = found.np_arrays["error_array"]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(found.stats["rmse"], rel=1e-12)
    for name in ("timestamps", "seconds_from_start", "distances_from_start"):
        assert len(found.np_arrays[name]) == len(error)
    reference, estimate = found.trajectories.values()
    again = np.linalg.norm(reference.positions_xyz - estimate.positions_xyz, axis=1)
    assert again == pytest.approx(error, abs=1e-12)


def test_evo_res_opens_them_all(exported, tmp_path):
    pytest.importorskip("evo")
    zips = sorted(exported("evo").glob("*.zip"))
    (program,) = entry_points(group="console_scripts", name="evo_res")
    code = f"from {program.module} import {program.attr} as f; f()"
    table = tmp_path / "table.csv"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, zips), "--save_table", str(table)],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        env={"MPLBACKEND": "Agg", "HOME": str(tmp_path), "PATH": ""},
    )
    assert done.returncode == 0, done.stderr
    assert len(table.read_text().splitlines()) == 1 + len(zips)


def test_the_statistics_are_evo_s():
    metrics = pytest.importorskip("evo.core.metrics")
    error = np.random.default_rng(3).gamma(2.0, 1e-3, 500)
    judge = metrics.APE(metrics.PoseRelation.translation_part)
    judge.error = error
    assert statistics(error) == pytest.approx(judge.get_all_statistics(), rel=1e-12)


def test_csv_has_every_sample_with_its_error(exported, _run):
    with (exported("csv") / f"{STEM}.eye.csv").open() as file:
        rows = list(csv.DictReader(file))
    error = np.array([float(row["error_mm"]) for row in rows])
    assert np.sqrt(np.mean(error**2)) == pytest.approx(rmse_mm(_run, "eye"), rel=1e-8)
    apart = [
        np.linalg.norm([float(r[f"truth_{a}_m"]) - float(r[f"estimate_{a}_m"]) for a in "xyz"])
        for r in rows
    ]
    assert 1e3 * np.array(apart) == pytest.approx(error, abs=1e-5)
    assert int(rows[0]["t_ns"]) < int(rows[1]["t_ns"])


def test_parquet_has_all_takes_and_the_metrics(exported, _run):
    folder = exported("parquet")
    parquet = pytest.importorskip("pyarrow.parquet")
    samples = parquet.read_table(folder / "samples.parquet").to_pydict()
    takes = {take.name for take in Bundle.open(_run).record.takes}
    assert set(samples["take"]) == takes
    mine = [
        error
        for error, take, point in zip(
            samples["error_mm"], samples["take"], samples["point"], strict=True
        )
        if (take, point) == (STEM.removesuffix(".robot"), "eye")
    ]
    assert np.sqrt(np.mean(np.square(mine))) == pytest.approx(rmse_mm(_run, "eye"), rel=1e-9)
    metrics = parquet.read_table(folder / "metrics.parquet")
    assert metrics.column_names == COLUMNS
    assert metrics.num_rows == len(read_rows(_run / TABLE))


def test_the_layout_names_the_topics_of_the_takes(exported):
    layout = json.loads((exported("foxglove") / "vrbench.layout.json").read_text())
    paths = [path["value"] for path in layout["configById"]["Plot!x"]["paths"]]
    assert paths == ["/headset/eye/pose.pose.position.x", "/robot/tcp.pose.position.x"]
    assert all(
        path["timestampMethod"] == "headerStamp" for path in layout["configById"]["Plot!x"]["paths"]
    )

    def leaves(part):
        return [part] if isinstance(part, str) else leaves(part["first"]) + leaves(part["second"])

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


@pytest.mark.parametrize("form", FORMATS)
def test_a_folder_with_files_is_not_written_to(run, tmp_path, form):
    (tmp_path / "mine.txt").write_text("")
    with pytest.raises(ConfigError, match="holds files already"):
        export(Bundle.open(run), form, PROTOCOL, tmp_path, lambda *_: None, pytest.fail)


def test_parquet_without_pyarrow_says_the_fix(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ConfigError, match=r"vrbench\[parquet\]"):
        export(Bundle.open(run), "parquet", PROTOCOL, tmp_path / "x", lambda *_: None, pytest.fail)


def test_a_zip_s_names_lead_nowhere(exported):
    with ZipFile(exported("evo") / f"{STEM}.eye.zip") as archive:
        assert all("/" not in name for name in archive.namelist())
    assert plain("../../etc/passwd") == "_.._etc_passwd"
