"""Configurations and their files."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand import config


def test_a_file_changes_only_the_numbers_that_it_names(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text("[tracing]\nnear = 0.8\n[filter]\nmin_neighbors = 7\n")
    loaded = config.load(path)
    expected = dataclasses.replace(
        strand.Config(), tracing=config.Tracing(near=0.8), filter=config.Filter(min_neighbors=7)
    )
    assert loaded == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[nonsense]\n", r"unknown section \[nonsense\]"),
        ("[tracing]\nfast = 1\n", r"\[tracing\] has no fast; known are near, far"),
        ("[tracing]\nnear = -1.0\n", "Tracing.near: expected a number above 0"),
        ("[tracing]\nnear = 3.0\n", "Tracing.far: expected more than near"),
        ("[tracing]\nnear = nan\n", "Tracing.near"),
        ("[splitting]\nthreshold = 7.0\n", "Splitting.neighborhood"),
        ("[filter]\nmin_neighbors = 1.5\n", "Filter.min_neighbors: expected a whole number"),
        ('[filter]\nradius = "big"\n', "Filter.radius: expected a number"),
        ("[filter]\nradius = true\n", "Filter.radius: expected a number"),
        ('[linking]\nrings = "sometimes"\n', "Linking.rings: expected one of maybe, never, always"),
        ("[linking]\nrings = true\n", "Linking.rings: expected one of maybe, never, always"),
        ("tracing = 3\n", r"write \[tracing\]"),
        ("[tracing\n", "config.toml"),
        ('method = "magic"\n', "Config.method: expected one of default, published"),
    ],
)
def test_errors_about_a_file_say_what_is_accepted(tmp_path, text, message):
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(strand.FileFormatError, match=message):
        config.load(path)


def test_the_published_method_is_one_configuration():
    assert strand.Config(method="published") == strand.Config.published()
    assert strand.Config.published().filter == strand.Config().filter
    assert strand.Config.published() != strand.Config()


def test_an_unknown_method_is_an_error():
    with pytest.raises(ValueError, match=r"Config\.method: expected one of default, published, got 'tube'"):
        strand.Config(method="tube")


def test_lengths_are_as_exact_as_the_configuration_says(paper, paper_model):
    true = 1.05 * paper_model.chains[0].length
    for known, doubted in ((config.Known(), True), (config.Known(length_share=0.08), False)):
        settings = strand.Config(known=known)
        model = strand.reconstruct(paper.views, paper.radius, paper.bounds, length=true, config=settings)
        assert ("length" in {doubt.kind for doubt in model.doubts}) is doubted


def test_a_radius_is_as_exact_as_the_configuration_says(paper):
    errors = []
    for known in (config.Known(radius_sd=1e-4), config.Known(radius_sd=0.3)):
        settings = strand.Config(known=known)
        model = strand.reconstruct(paper.views, 0.9 * paper.radius, paper.bounds, config=settings)
        errors.append(abs(model.chains[0].radius - paper.radius))
    assert errors[1] < 0.3 * errors[0]


def test_numbers_that_would_fill_the_memory_are_errors():
    for wrong in ({"spacing": 1e-6}, {"node_spacing": 1e-12}, {"rounds": 0}, {"min_bend": 0.5}):
        (name,) = wrong
        with pytest.raises(ValueError, match=rf"Tubes\.{name}: expected at least"):
            config.Tubes(**wrong)


def test_a_section_of_another_kind_is_an_error():
    with pytest.raises(TypeError, match=r"Config\.tracing: expected type Tracing"):
        strand.Config(tracing=config.Filter())  # type: ignore[arg-type]


def test_every_number_is_documented():
    values = [getattr(strand.Config(), entry.name) for entry in dataclasses.fields(strand.Config)]
    sections = [value for value in values if dataclasses.is_dataclass(value)]
    numbers = [(section, entry.name) for section in sections for entry in dataclasses.fields(section)]
    assert len(numbers) > 30
    for section, name in numbers:
        assert f"    {name} : " in type(section).__doc__


def test_numbers_of_numpy_are_numbers():
    section = config.Filter(min_neighbors=np.int64(7), radius=np.float64(1.5), min_fraction=np.array(0.5))
    assert section == config.Filter(min_neighbors=7, radius=1.5, min_fraction=0.5)
    assert [type(value) for value in dataclasses.astuple(section)] == [float, float, int, float]
