"""Tables of tracks: their rows, and what an error leaves."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

import strand
from shared.tracks import NODES, make_tracks
from strand.batch import make_schema, write_tracks


@pytest.fixture
def tracks():
    return make_tracks()


def test_a_row_is_a_rope_of_a_frame_with_its_events(tracks, tmp_path):
    path = tmp_path / "tracks.parquet"
    assert write_tracks(iter(tracks), path, "a") == 4
    assert pq.read_schema(path).remove_metadata().equals(make_schema())
    assert pq.ParquetFile(path).metadata.metadata[b"strand.schema"] == b"4"
    rows = pq.read_table(path).to_pylist()
    assert [(row["frame"], row["rope"]) for row in rows] == [(0, None), (1, 0), (2, 0), (2, 1)]
    assert {row["recording"] for row in rows} == {"a"}
    assert rows[0]["nodes"] is None
    assert rows[0]["warnings"] == ["no rope: the tracker has found none so far"]
    assert rows[0]["events"] == []
    assert [row["confidence"] for row in rows] == [None, None, None, 0.9]
    assert rows[3]["label"] == 7
    np.testing.assert_array_equal(rows[3]["covariance"][5], (1e-6 * np.diag([1.0, 2.0, 3.0])).ravel())
    assert rows[3]["predicted"] == (np.linspace(0.0, 0.2, NODES) > 0.1).tolist()
    crossing, begun = rows[3]["events"]
    assert crossing == {
        "kind": "crossing made",
        "s": 0.05,
        "under_rope": 0,
        "under_s": 0.15,
        "doubtful": True,
    }
    assert (begun["kind"], begun["s"], begun["under_rope"]) == ("begun", None, None)
    assert rows[2]["events"] == []


def test_many_rows_are_written_in_parts_and_an_error_leaves_the_file(tracks, tmp_path):
    path = tmp_path / "tracks.parquet"
    write_tracks(tracks * 150, path)
    file = pq.ParquetFile(path)
    assert file.metadata.num_rows == 600
    assert file.metadata.num_row_groups > 1
    before = path.read_bytes()

    def stop():
        yield tracks[1]
        raise strand.StrandError("enough")

    with pytest.raises(strand.StrandError, match="enough"):
        write_tracks(stop(), path)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["tracks.parquet"]
