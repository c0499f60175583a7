"""Tests of saving and loading models."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import strand
from shared.ropes import draw_circle, make_zigzags
from strand import Chain, Model
from strand.io.models import load_frames
from strand.ropes.crossings import NOT_LISTED
from strand.ropes.doubt import ModelWarning
from strand.support.files import JSON_BYTES


@given(
    st.lists(
        st.tuples(*[st.floats(-10, 10, allow_subnormal=False)] * 3), min_size=2, max_size=20, unique=True
    ),
    st.booleans(),
)
def test_any_chain_survives_its_file_bit_for_bit(tmp_path_factory, nodes, closed):
    points = np.array(nodes)
    # nodes that differ only by rounding count as equal
    assume((np.linalg.norm(np.diff(np.vstack([points, points[:1]]), axis=0), axis=1) >= 1e-12).all())
    path = tmp_path_factory.mktemp("model") / "model.json"
    warning = ModelWarning("branch", "a branch?", points[0], 0.25, (0, 1), 2)
    model = Model(
        (Chain(points, 0.0042, closed),),
        np.eye(4)[None],
        {"trace": 0.25},
        (warning,),
        method="default",
        branch="tubes",
    )
    model.save(path)
    loaded = strand.load_model(path)
    np.testing.assert_array_equal(loaded.chains[0].points, points)
    assert loaded.chains[0].radius == 0.0042
    assert loaded.chains[0].closed is closed
    np.testing.assert_array_equal(loaded.poses, model.poses)
    assert loaded.timings == model.timings
    (again,) = loaded.warnings
    np.testing.assert_array_equal(again.place, warning.place)
    for name in ("kind", "message", "amount", "chains", "view"):
        assert getattr(again, name) == getattr(warning, name)
    assert (loaded.method, loaded.branch) == ("default", "tubes")


def test_labels_colours_and_hidden_ends_survive_and_older_files_have_none(tmp_path):
    path, nodes = tmp_path / "model.json", [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    chain = Chain(np.array(nodes), 0.004, label=3, color=[1.0, 1.0 / 3.0, 0.0], hidden_ends=(True, False))
    Model((chain,), np.eye(4)[None]).save(path)
    (loaded,) = strand.load_model(path).chains
    assert (loaded.label, loaded.hidden_ends) == (3, (True, False))
    np.testing.assert_array_equal(loaded.color, chain.color)
    data = json.loads(path.read_text())
    for name in ("label", "color", "hidden_ends"):
        del data["chains"][0][name]
    path.write_text(json.dumps(data))
    validate(path)
    (older,) = strand.load_model(path).chains
    assert (older.label, older.color, older.hidden_ends) == (None, None, (False, False))


def validate(path):
    """Return the content of a model's file that keeps to the schema."""
    schema = Path(__file__).parents[3] / "docs" / "model.schema.json"
    content = json.loads(path.read_text())
    jsonschema.Draft202012Validator(json.loads(schema.read_text())).validate(content)
    return content


def test_a_model_with_too_many_crossings_to_list_is_saved_and_loaded(tmp_path):
    path, model = tmp_path / "model.json", make_zigzags(500)
    begun = time.process_time()
    model.save(path)
    loaded = strand.load_model(path)
    assert time.process_time() - begun < 4.0
    for one, other in zip(loaded.chains, model.chains, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
    # an empty list would say that nothing crosses
    assert "crossings" not in validate(path)
    assert NOT_LISTED in model.summary()


def test_crossings_in_an_older_file_are_those_that_the_model_finds(tmp_path):
    path, model = tmp_path / "model.json", make_zigzags(20)
    model.save(path)
    content = validate(path)
    assert [one["over"] for one in content["crossings"]] == [list(one.over) for one in model.crossings()]
    # older files list all crossings, or none of many nodes
    for listed in (3 * content["crossings"], []):
        path.write_text(json.dumps(content | {"crossings": listed}))
        validate(path)
        assert len(strand.load_model(path).crossings()) == len(content["crossings"])


def test_what_is_saved_is_no_larger_than_what_may_be_loaded(tmp_path):
    path, turns = tmp_path / "model.json", np.linspace(0.1, 9.0, 200)
    model = Model(
        (Chain(np.column_stack([np.log(turns), np.sin(turns), np.sqrt(turns)]), 0.01),), np.eye(4)[None]
    )
    model.save(path)
    with pytest.raises(strand.FileFormatError, match=r"may take .* more than 2 x max_bytes=") as caught:
        strand.load_model(path, max_bytes=path.stat().st_size)
    size = (int(re.findall(r"may take (\d+) bytes", str(caught.value))[0]) + 1) // 2
    model.save(path, max_bytes=size)
    assert len(strand.load_model(path, max_bytes=size).chains) == 1
    with pytest.raises(strand.StrandError, match=f"more memory than 2 x max_bytes={size - 1}"):
        model.save(tmp_path / "other.json", max_bytes=size - 1)
    assert [entry.name for entry in tmp_path.iterdir()] == ["model.json"]
    with pytest.raises(strand.FileFormatError, match=f"more than 2 x max_bytes={size - 1}"):
        strand.load_model(path, max_bytes=size - 1)
    # models of 64 MiB fit the default
    assert size < 3.5 * path.stat().st_size
    assert JSON_BYTES >= 3.5 * (64 << 20)


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "model.json"
    model = Model((draw_circle(0.05, 10, True),), np.eye(4)[None])
    model.save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        Model(model.chains, model.poses, {"trace": np.inf}).save(path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["model.json"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 1}, "model version 1, this reads version 2"),
        ({"version": 3}, "model version 3, this reads version 2"),
        ({"version": None}, "model version None, this reads version 2"),
        ({"format": "strand scene"}, "not a strand model"),
        ({"warnings": ["a branch?"]}, "not a strand model"),
        ({"warnings": [{"kind": "magic", "message": "a branch?"}]}, "kind: expected one of"),
        ({"doubts": [{"amount": 0.1, "about": "it", "reason": "so"}]}, "kind"),
        ({"chains": [{}]}, "not a strand model"),
        ({"poses": None}, "not a strand model"),
    ],
)
def test_a_model_of_another_version_or_kind_is_refused_with_the_reason(tmp_path, change, message):
    path = tmp_path / "other.json"
    Model((draw_circle(0.05, 10, True),), np.eye(4)[None]).save(path)
    content = json.loads(path.read_text())
    assert strand.load_model(path).chains
    path.write_text(json.dumps(content | change))
    with pytest.raises(strand.FileFormatError, match=rf"other\.json: .*{message}"):
        strand.load_model(path)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"format": "other"}',
        '{"format": "strand model", "version": 2}',
        '{"format": "strand model", "version": 1, "chains": [{}], "poses": [], "timings": {}, '
        '"warnings": []}',
    ],
)
def test_a_file_that_is_no_model_is_refused_by_name(tmp_path, content):
    path = tmp_path / "broken.json"
    path.write_text(content)
    with pytest.raises(strand.FileFormatError, match=r"broken\.json"):
        strand.load_model(path)


def test_a_truncated_model_is_refused(tmp_path):
    path = tmp_path / "model.json"
    Model((draw_circle(0.05, 50, True),), np.eye(4)[None]).save(path)
    text = path.read_text()
    json.loads(text)
    path.write_text(text[: len(text) // 2])
    with pytest.raises(strand.FileFormatError, match=r"model\.json"):
        strand.load_model(path)
    with pytest.raises(FileNotFoundError):
        strand.load_model(tmp_path / "missing.json")


def test_numbers_of_numpy_are_saved_and_methods_are_known(tmp_path):
    model = strand.Model((), np.eye(4, dtype=int)[None], {"fit": np.float32(0.5)}, confidence=np.float32(0.5))
    model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json")
    assert (loaded.confidence, loaded.timings) == (0.5, {"fit": 0.5})
    with pytest.raises(ValueError, match="method: expected one of default, published, got 'magic'"):
        strand.Model((), np.eye(4)[None], method="magic")


@pytest.mark.parametrize("head", [b"\x89MCAP0\r\n", b"PK\x03\x04", b"ply\nformat ascii 1.0\n", b"\xff\xfe{"])
def test_files_of_other_formats_are_no_json_whatever_their_size(head, tmp_path):
    path = tmp_path / "rope.mcap"
    path.write_bytes(head + b'\xff,"[{' * 1000)  # which would take much memory as JSON
    for most in (10, 10_000, JSON_BYTES):
        with pytest.raises(strand.FileFormatError, match=r"not JSON \(it begins with") as caught:
            strand.load_model(path, max_bytes=most)
        assert caught.value.reason.endswith(f"{head[:8]!r})" if len(head) >= 8 else ")")


@pytest.mark.parametrize("head", [b"", b"\xef\xbb\xbf", b"\n\t " * 50])
def test_models_may_begin_with_a_mark_or_spaces(head, tmp_path):
    path = tmp_path / "model.json"
    make_zigzags(2).save(path)
    path.write_bytes(head + path.read_bytes())
    assert len(strand.load_model(path).chains) == 2


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("failed", [False, True])
def test_lines_of_frames_are_referred_to_their_reader(frames, failed, tmp_path):
    path, saved = tmp_path / "models.jsonl", tmp_path / "model.json"
    make_zigzags(2).save(saved)
    one = {"error": "none"} if failed else {"model": json.loads(saved.read_text())}
    path.write_text("".join(json.dumps({"frame": k, "stamp": k} | one) + "\n" for k in range(frames)))
    assert len(list(load_frames(path))) == frames
    for most in (10, JSON_BYTES):
        with pytest.raises(strand.FileFormatError, match=r"strand\.io\.models\.load_frames"):
            strand.load_model(path, max_bytes=most)
