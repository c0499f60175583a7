"""All unsafe code is listed here, and says why it is sound."""

from __future__ import annotations

import re
from pathlib import Path

SOURCES = Path(__file__).parents[3] / "rust" / "src"

# number of blocks and impls by file; another one needs a reason
LISTED = {
    "clouds/filter.rs": 2,
    "index/cells.rs": 1,
    "index/sort.rs": 1,
    "normals.rs": 1,
    "normals/planes.rs": 2,
    "parallel.rs": 3,
    "published/centerline.rs": 2,
    "python/arguments.rs": 1,
    "python/arrays.rs": 5,
    "python/called.rs": 1,
    "simd.rs": 5,
    "simd/avx2.rs": 10,
    "simd/avx512.rs": 10,
    "simd/proven.rs": 2,
}


def test_unsafe_code_is_where_it_is_listed_and_says_why_it_is_sound():
    found = {}
    for path in sorted(SOURCES.rglob("*.rs")):
        lines = path.read_text().splitlines()
        code = [line.split("//")[0] for line in lines]
        blocks = [i for i, line in enumerate(code) if re.search(r"\bunsafe\s*(\{|impl\b)", line)]
        if blocks:
            found[path.relative_to(SOURCES).as_posix()] = len(blocks)
        for i in blocks:
            above = lines[max(i - 4, 0) : i + 1]
            assert any("SAFETY:" in line for line in above), f"{path}:{i + 1}"
    assert found == LISTED
