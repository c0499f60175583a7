"""Models as tables and polylines, and the schema of their JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import jsonschema
import numpy as np
import open3d as o3d
import pytest

import strand
from lib import whole_files
from shared.ropes import R, draw_circle
from strand import load_scene
from strand.export.files import COLUMNS
from strand.ropes.crossings import Crossing
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning

SCHEMA = json.loads((Path(__file__).parents[3] / "docs" / "model.schema.json").read_text())
OPEN = strand.Chain(
    np.linspace([0.0, 0.0, 0.1], [0.4, 0.1, 0.1], 11),
    R,
    points_seen=np.arange(11),
    views_seen=np.ones(11, int),
)
MODEL = strand.Model((OPEN, draw_circle(0.05, 40, True)), np.eye(4)[None])


def test_a_table_has_a_row_for_each_node(tmp_path, paper_model):
    for model in (MODEL, paper_model):
        model.save(tmp_path / "a.csv")
        with (tmp_path / "a.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert tuple(rows[0]) == COLUMNS
        for k, chain in enumerate(model.chains):
            own = [row for row in rows if row["chain"] == str(k)]
            assert [int(row["node"]) for row in own] == list(range(len(chain.points)))
            np.testing.assert_array_equal([[float(row[axis]) for axis in "xyz"] for row in own], chain.points)
            np.testing.assert_array_equal([float(row["s"]) for row in own], chain.arc_length)
            assert {float(row["radius"]) for row in own} == {chain.radius}
            assert {row["closed"] for row in own} == {"1" if chain.closed else "0"}
            seen = [""] * len(own) if chain.points_seen is None else [str(n) for n in chain.points_seen]
            assert [row["points_seen"] for row in own] == seen
        assert sum(len(chain.points) for chain in model.chains) == len(rows)


def test_tables_and_polylines_are_read_back_as_points(tmp_path):
    places = np.concatenate([chain.points for chain in MODEL.chains])
    for name in ("a.csv", "a.ply"):
        MODEL.save(tmp_path / name)
        (view,) = load_scene(tmp_path / name, camera_frame=True).views
        np.testing.assert_array_equal(view.points, places)


def test_open3d_reads_polylines(tmp_path):
    MODEL.save(tmp_path / "a.ply")
    lines = o3d.io.read_line_set(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(np.asarray(lines.points), np.concatenate([c.points for c in MODEL.chains]))
    steps = [[i, i + 1] for i in range(10)] + [[11 + i, 11 + (i + 1) % 40] for i in range(40)]
    np.testing.assert_array_equal(np.asarray(lines.lines), steps)


@pytest.mark.parametrize("name", ["a.csv", "a.ply", "a.json", "A.JSON"])
def test_models_without_ropes(tmp_path, name):
    strand.Model((), np.eye(4)[None]).save(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    if name == "a.csv":
        assert data.decode() == ",".join(COLUMNS) + "\n"
    elif name == "a.ply":
        assert b"element vertex 0\n" in data
    else:
        assert strand.load_model(tmp_path / name).chains == ()


@pytest.mark.parametrize("name", ["a", "a.obj", "a.json.gz", ".json"])
def test_other_names_are_refused_and_nothing_is_written(tmp_path, name):
    with pytest.raises(ValueError, match=r"expected a name that ends with \.json or \.csv or \.ply"):
        MODEL.save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def validate(content):
    jsonschema.Draft202012Validator(SCHEMA).validate(content)


def test_what_is_saved_is_as_the_schema_says(tmp_path, paper_model):
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    for model in (MODEL, paper_model, strand.Model((), np.eye(4)[None], method="published")):
        model.save(tmp_path / "a.json")
        validate(json.loads((tmp_path / "a.json").read_text()))
    everything = json.loads(whole_files.make_model()) | {"units": "metres, radians, seconds"}
    validate(everything)


@pytest.mark.parametrize("key", SCHEMA["properties"])
def test_what_the_schema_refuses_is_not_read_either(tmp_path, key):
    """Give each key a value of another kind: schema and reader refuse it, and the reader says where."""
    content = json.loads(whole_files.make_model()) | {"units": "metres, radians, seconds"}
    for wrong in ("wrong", [1], {"a": []}):
        changed = content | {key: wrong}
        with pytest.raises(jsonschema.ValidationError):
            validate(changed)
        if key == "units":  # nobody reads it
            continue
        (tmp_path / "a.json").write_text(json.dumps(changed))
        with pytest.raises(strand.FileFormatError, match=r"a\.json: "):
            strand.load_model(tmp_path / "a.json")


def test_every_field_of_the_values_is_in_the_schema():
    for name, kind in (
        ("chain", strand.Chain),
        ("warning", ModelWarning),
        ("join", Join),
        ("doubt", Doubt),
        ("alternative", Alternative),
        ("sensor", strand.Sensor),
        ("crossing", Crossing),
    ):
        # the direction of chains is that of their model
        fields = set(kind.__dataclass_fields__) - ({"up"} if name == "chain" else set())
        properties, required = (set(SCHEMA["$defs"][name][key]) for key in ("properties", "required"))
        # older files have none of these
        newer = {"label", "color", "hidden_ends"} if name == "chain" else set()
        assert properties == required | newer == fields
    fields = set(strand.Model.__dataclass_fields__) - {"stages"}
    assert set(SCHEMA["properties"]) == fields | {"format", "version", "units", "crossings"}


@pytest.mark.parametrize(
    ("change", "place", "reason"),
    [
        (lambda c: c.pop("joins"), None, "missing joins"),
        (lambda c: c["chains"][0].pop("curve"), "chains[0]", "missing curve"),
        (lambda c: c["chains"][0]["curve"].pop("stop"), "chains[0]", "missing stop"),
        (lambda c: c["chains"][0]["points"][1].append(2.0), "chains[0]", ""),
        (lambda c: c["chains"][0].update(radius=-1), "chains[0]", "radius: expected a positive number"),
        (lambda c: c["chains"].append({}), "chains[1]", "missing curve"),
        (lambda c: c["poses"][0].pop(), "poses", ""),
        (lambda c: c["doubts"][0].update(kind="magic"), "doubts[0]", "kind: expected one of"),
        (lambda c: c["timings"].update(fit="long"), "timings", "fit: expected a number"),
        (lambda c: c.update(confidence=2.0), None, "confidence: expected a number from 0 to 1"),
        (lambda c: c.update(method="magic"), None, "method: expected one of"),
        (lambda c: c["sensor"].update(colour=1), "sensor", "colour"),
        (lambda c: c.update(chains={}), "chains", "expected a sequence"),
        (lambda c: c["crossings"][0].update(sign=0), "crossings[0]", "sign: expected 1 or -1"),
        (lambda c: c["crossings"][0].pop("over"), "crossings[0]", "over"),
        (lambda c: c["crossings"][0].update(under=[0]), "crossings[0]", "under: expected a chain's number"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path, change, place, reason):
    content = json.loads(whole_files.make_model())
    change(content)
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(strand.FileFormatError, match="not a strand model") as caught:
        strand.load_model(tmp_path / "a.json")
    assert caught.value.place == place
    assert reason in caught.value.reason
