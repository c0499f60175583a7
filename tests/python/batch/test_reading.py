"""Reading batches: tables, models and the summary page."""

from __future__ import annotations

import re
import time

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import strand
from lib.bag_files import record_film, write_bag
from shared.batch_recordings import SETTINGS, save_scenes
from shared.browser import start_chromium
from strand.batch import (
    Settings,
    load_models,
    load_table,
    make_schema,
    reading,
    rows,
    run,
    summary,
    write_summary,
)
from strand.batch.links import Links
from strand.batch.shards import list_shards
from strand.batch.summary import Summary, summarize
from strand.ropes.doubt import ModelWarning
from strand.support import pages
from strand.support.files import FileFormatError, read_at

SCENE = strand.synthetic.scene("arc", seed=0, views=3)
KNOWN = {"radius": 0.0042, "bounds": SCENE.bounds}


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """A scene, a broken one, and a recording of three frames in two stretches."""
    folder, out = tmp_path_factory.mktemp("in"), tmp_path_factory.mktemp("out")
    film_of = tmp_path_factory.mktemp("film") / "film"
    write_bag(film_of, "mcap", record_film(SCENE, 3)).rename(folder / "film.mcap")
    save_scenes(folder, 1)
    (folder / "broken.npz").write_bytes(b"nonsense")
    run(folder, out, Settings(**KNOWN, world="world", stretch=2), root=folder)
    return folder, out


def test_a_table_is_in_order_and_of_the_schema(batch):
    table = load_table(batch[1])
    assert table.schema == make_schema()
    places = [(row["recording"], row["frame"]) for row in table.select(["recording", "frame"]).to_pylist()]
    assert places == [("0/00.npz", 0), ("broken.npz", None), *(("film.mcap", k) for k in range(3))]
    assert load_table(batch[1], ["rope", "error"]).schema.names == ["rope", "error"]


def test_models_are_those_of_reconstruct(batch):
    folder, out = batch
    found = {(name, frame): model for name, frame, model in load_models(out)}
    assert set(found) == {("0/00.npz", 0), *(("film.mcap", k) for k in range(3))}
    with strand.Recording(folder / "film.mcap", world="world") as recording:
        previous = None
        for frame in recording.read(0, 2):
            want = previous = strand.reconstruct(frame.views, **KNOWN, previous=previous)
            got = found["film.mcap", frame.number]
            for chain, other in zip(got.chains, want.chains, strict=True):
                np.testing.assert_array_equal(chain.points, other.points)
                np.testing.assert_array_equal(chain.covariance, other.covariance)
                assert (chain.radius, chain.closed, chain.confidence) == (
                    other.radius,
                    other.closed,
                    other.confidence,
                )
            assert got.confidence == want.confidence
            np.testing.assert_array_equal(got.up, want.up)
            np.testing.assert_array_equal(got.table.normal, want.table.normal)
            assert got.table.offset == want.table.offset
            about = {(w.kind, w.message) for w in want.warnings}
            assert {(w.kind, w.message) for w in got.warnings} == about


def test_warnings_name_the_chains_in_whose_rows_they_stand():
    model = strand.Model(
        tuple(strand.Chain(np.array([[0.0, 0, k], [0.1, 0, k], [0.2, 0, k]]), 0.004) for k in range(3)),
        np.empty((0, 4, 4)),
        warnings=[
            ModelWarning("cut end", "here", chains=(1,)),
            ModelWarning("cut end", "here", chains=(1,)),
            ModelWarning("branch", "there", chains=(0, 2)),
            ModelWarning("noise", "of all"),
            ModelWarning("open pose", "twice", view=0),
            ModelWarning("open pose", "twice", view=0),
        ],
    )
    made = rows.make_model_rows("a.npz", 0, None, model, 0.0)
    table = [{"rope": row.rope, "warnings": row.warnings} for row in made]
    found = [(one.kind, one.message, one.chains) for one in reading._make_warnings(table)]
    assert sorted(found) == sorted((one.kind, one.message, one.chains) for one in model.warnings)


def test_warnings_of_a_single_chain_name_it_or_none():
    rows = [{"rope": 0, "warnings": ["cut end: chain 0 runs out", "noise: of all"]}]
    assert [(one.kind, one.chains) for one in reading._make_warnings(rows)] == [
        ("cut end", (0,)),
        ("noise", ()),
    ]
    rows = [{"rope": None, "warnings": ["no rope: nothing is there"]}]
    assert [(one.kind, one.chains) for one in reading._make_warnings(rows)] == [("no rope", ())]


def test_an_empty_folder_is_an_empty_table(tmp_path):
    assert load_table(tmp_path).schema == make_schema()
    assert list(load_models(tmp_path)) == []
    with pytest.raises(FileNotFoundError):
        load_table(tmp_path / "missing")


def test_damaged_shards_and_unknown_columns_are_errors(tmp_path):
    run(save_scenes(tmp_path / "in", 1), tmp_path / "out", SETTINGS)
    with pytest.raises(ValueError, match="columns: expected some of recording, frame"):
        load_table(tmp_path / "out", ["length"])
    (name,) = list_shards(tmp_path / "out")
    shard = tmp_path / "out" / name
    for content in (b"", b"PAR1", shard.read_bytes()[:-20], b"\0" * 200):
        shard.write_bytes(content)
        for read in (load_table, lambda out: list(load_models(out)), summarize):
            with pytest.raises(FileFormatError, match="truncated, damaged or not a shard"):
                read(tmp_path / "out")


def test_each_changed_byte_of_a_footer_is_an_error(tmp_path):
    run(save_scenes(tmp_path / "in", 1), tmp_path / "out", SETTINGS, workers=1)
    (name,) = list_shards(tmp_path / "out")
    shard = tmp_path / "out" / name
    whole = shard.read_bytes()
    start = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    # pyarrow must not see them: it ends the process at some
    for place in [*range(start - 4, len(whole) - 8, 11), *range(len(whole) - 4, len(whole))]:
        shard.write_bytes(whole[:place] + bytes([whole[place] ^ 0x40]) + whole[place + 1 :])
        with pytest.raises(FileFormatError, match=r"the footer's checksum is wrong|no footer"):
            load_table(tmp_path / "out", ["radius"])
    # files from before seals are read
    shard.write_bytes(whole[: start - 8] + whole[start:])
    older = load_table(tmp_path / "out")
    shard.write_bytes(whole)
    assert older.num_rows > 0
    assert load_table(tmp_path / "out").equals(older)
    assert pl.read_parquet(shard)["radius"].to_list() == older["radius"].to_pylist()


def test_a_changed_byte_of_a_shard_is_noticed(tmp_path):
    run(save_scenes(tmp_path / "in", 1), tmp_path / "out", SETTINGS, workers=1)
    (name,) = list_shards(tmp_path / "out")
    shard, before = tmp_path / "out" / name, load_table(tmp_path / "out")
    whole, refused = shard.read_bytes(), 0
    for place in range(4, len(whole), 61):
        shard.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        try:
            assert load_table(tmp_path / "out").equals(before)
        except FileFormatError:
            refused += 1
    assert refused > len(whole) // 61 // 2
    # changed types are noticed too
    table = pq.read_table(pa.BufferReader(whole))
    place = table.schema.get_field_index("radius")
    other = table.set_column(place, "radius", table["radius"].cast(pa.float32()))
    pq.write_table(other, shard)
    with pytest.raises(FileFormatError, match="other columns"):
        load_table(tmp_path / "out")


def test_shards_that_take_more_than_the_limit_are_refused_by_their_headers(batch, tmp_path):
    _, out = batch
    readers = (
        load_table,
        lambda out, **size: list(load_models(out, **size)),
        lambda out, **size: write_summary(out, tmp_path / "page.html", **size),
    )
    for read in readers:
        read(out, max_bytes=20_000_000)
        with pytest.raises(
            FileFormatError, match=r"may take \d+ bytes of memory, .* give \d+ or more as max_bytes"
        ):
            read(out, max_bytes=1_000_000)


def test_the_tables_of_all_shards_share_the_limit(batch, tmp_path):
    (tmp_path / "aa").mkdir()
    source = batch[1] / next(one for one in list_shards(batch[1]) if "errors" not in one)
    for k in range(60):
        (tmp_path / "aa" / f"{k:016}-{k:016}-0-end.parquet").write_bytes(source.read_bytes())
        if k == 0:
            load_table(tmp_path, max_bytes=7_000_000)
    whole = load_table(tmp_path)
    with pytest.raises(FileFormatError, match="left of 2 x max_bytes"):
        load_table(tmp_path, max_bytes=7_000_000)
    # reading a shard takes some 12 MB, and only its table stays
    assert load_table(tmp_path, max_bytes=7_000_000 + whole.nbytes // 2).equals(whole)


def test_pages_that_declare_less_than_they_hold_are_refused(tmp_path):
    run(save_scenes(tmp_path / "in", 1), tmp_path / "out", SETTINGS, workers=1)
    (name,) = list_shards(tmp_path / "out")
    with open(tmp_path / "out" / name, "rb") as file:
        metadata = pq.read_metadata(tmp_path / "out" / name)
        column = metadata.row_group(0).column(4)
        data = read_at(file, column.data_page_offset, column.total_compressed_size)
        count, size, values = pages._sum_pages(data)
        assert (count, values) == (1, column.num_values)
        assert size >= column.total_uncompressed_size - 100
        for cut in (data[:-1], data[:20], data[:3], b"\x1c" * 50, b"\x19" + data):
            with pytest.raises(ValueError, match=r"a page|a header|a number"):
                pages._sum_pages(cut)


def test_shards_hold_the_version_of_the_schema_and_others_are_refused(batch, tmp_path):
    _, out = batch
    for name in list_shards(out):
        said = pq.read_metadata(out / name).metadata
        assert (said[b"strand.schema"], len(said[b"strand.input"])) == (b"4", 16)
    (tmp_path / name).parent.mkdir()
    pq.write_table(load_table(out), tmp_path / name)
    with pytest.raises(
        FileFormatError, match=r"strand\.schema: expected a shard with version 4 of the schema, got none"
    ):
        load_table(tmp_path)


def test_a_summary_counts_rows_errors_and_ropes(batch, tmp_path):
    _, out = batch
    found = summarize(out)
    assert (found.recordings, found.frames, found.answered) == (3, 5, 4)
    assert len(found.confidence) == len(found.lengths) == 4
    lengths = sorted(chain.length for _, _, model in load_models(out) for chain in model.chains)
    np.testing.assert_allclose(sorted(found.lengths), lengths, rtol=1e-3)
    ((kind, (count, *example)),) = found.errors.items()
    assert kind.startswith("FileFormatError: truncated, or not an .npz file")
    assert (count, example[0], example[1].split(":")[0]) == (1, "broken.npz", "FileFormatError")
    spent = load_table(out, ["seconds"]).column(0).to_pylist()
    assert found.seconds == pytest.approx(sum(spent))
    assert found.slowest[0][0] == max(spent)
    models = sorted((model.confidence, name, frame) for name, frame, model in load_models(out))
    assert list(found.unsure) == models
    write_summary(out, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "3 recordings, 5 frames, 4 of them answered (80.0%), 4 ropes" in page
    assert "://" not in page
    unsure = page.split("<h2>Least sure frames</h2>")[1].split("<h2>")[0]
    shown = [float(cell) for cell in re.findall(r'<td class="n">(\d\.\d+)</td>', unsure)]
    assert shown == [np.floor(100 * confidence) / 100 for confidence, _, _ in models]
    write_summary(tmp_path, tmp_path / "empty.html")
    assert "0 recordings, 0 frames" in (tmp_path / "empty.html").read_text()


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (
            "FileFormatError: /data/a 12.npz: truncated after 1,200 of 3.5e+06 bytes",
            "FileFormatError: truncated after N of N bytes",
        ),
        ("FileFormatError: /data/a 12.npz/0.png: not a PNG file", "FileFormatError: not a PNG file"),
        ("FileFormatError: /our data/a 12.npz: x/y: not one", "FileFormatError: x/y: not one"),
        (
            "FileFormatError: /data/a 12.npz: no bag (File '/data/a 12.npz' is empty.)",
            "FileFormatError: no bag (File 'PATH' is empty.)",
        ),
        (
            "OSError: a 12.npz is gone, and so are /links/b/a 12.npz/0.png, a 12.npz.",
            "OSError: PATH is gone, and so are PATH, PATH.",
        ),
        (
            "OSError: not a 12.npzs, ba 12.npz or a 12.npz.old",
            "OSError: not a N.npzs, ba N.npz or a N.npz.old",
        ),
        (
            "FileFormatError: /x.npz: not an archive, got 7.",
            "FileFormatError: /x.npz: not an archive, got N.",
        ),
        ("NotEnoughDataError: views: no point in 4 views", "NotEnoughDataError: views: no point in N views"),
        ("WorkerDied", "WorkerDied"),
    ],
)
def test_kinds_of_errors_ignore_paths_and_numbers(error, kind):
    assert summary._classify_error(error, "a 12.npz") == kind


def test_other_paths_stay_in_the_kind_of_an_error():
    error = "FileFormatError: /data/mon/a/0.png: a hole, as in '/data/mon/a' and /other/a/1.png: b/a"
    assert summary._classify_error(error, "mon/a") == "FileFormatError: a hole, as in 'PATH' and PATH: PATH"
    assert summary._classify_error("OSError: a (x", "(x") == "OSError: a (x"


def test_equal_errors_of_several_files_are_one_kind(tmp_path):
    folder = tmp_path / "our ropes"
    for name in ("mon/7.bag", "mon/rope b.bag", "tue day/x(1).bag", "tue day/long_1.3.bag", "knöt.bag"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    run(folder, tmp_path / "out", SETTINGS, root=folder)
    assert [count for count, *_ in summarize(tmp_path / "out").errors.values()] == [5]


def test_kinds_that_are_not_listed_are_counted(tmp_path):
    errors = {f"OSError: {'x' * k}": (100 - k, "a", "OSError") for k in range(33)}
    links = Links(tmp_path / "page.html", None)
    page = summary._make_page(Summary(1, 3, 0, np.empty(0), np.empty(0), errors, [], [], 1.5), "", links)
    assert page.count("OSError: x") == 29
    assert "3 more kinds, in 207 frames." in page
    few = dict(list(errors.items())[:30])
    assert "more kinds" not in summary._make_page(
        Summary(1, 3, 0, np.empty(0), np.empty(0), few, [], [], 1.5), "", links
    )


def test_a_page_is_no_wider_than_its_window_and_numbers_are_flush_right(tmp_path):
    name = "recording_of_a_rope" * 40
    errors = {f"FileFormatError: {name}": (3, name, f"FileFormatError: {name}")}
    found = Summary(1, 3, 0, np.empty(0), np.empty(0), errors, [(0.5, name, 2)], [(1.5, name, 2)], 1.5)
    links = Links(tmp_path / "page.html", tmp_path)
    (tmp_path / "page.html").write_text(summary._make_page(found, f"Ropes in {name}", links))
    with start_chromium(tmp_path / "browser") as page:
        size = {"width": 800, "height": 600, "deviceScaleFactor": 1, "mobile": False}
        page.ask("Emulation.setDeviceMetricsOverride", **size)
        page.ask("Page.navigate", url=(tmp_path / "page.html").as_uri())
        while page.value("document.readyState") != "complete" or not page.value("document.title"):
            time.sleep(0.02)
        assert page.value("document.documentElement.scrollWidth") <= 800
        columns = (
            "[...document.querySelectorAll('tr:nth-child(2) td')].map(d => getComputedStyle(d).textAlign)"
        )
        assert page.value(columns) == ["left", "right", "left", *["right", "left", "right"] * 2]


def test_names_of_recordings_are_escaped_on_a_page(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "<b>&.npz").write_bytes(b"nonsense")
    run(folder, tmp_path / "out", SETTINGS, root=folder)
    write_summary(tmp_path / "out", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "&lt;b&gt;&amp;.npz" in page
    assert "<b>" not in page
