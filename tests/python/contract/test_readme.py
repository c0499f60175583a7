"""The README's commands and length; `test_code_blocks.py` runs its examples."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "README.md").read_text()
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))


def test_the_commands_exist():
    assert re.findall(r"^\./run (\w+)", SHELL, re.MULTILINE) == ["demo", "test"]
    done = subprocess.run([ROOT / "run"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "./run demo" in done.stderr
    scripts = re.findall(r"`python (benches/\w+\.py)", README)
    assert len(scripts) > 4
    assert [script for script in scripts if not (ROOT / script).is_file()] == []


def test_it_is_short():
    assert len(README.splitlines()) <= 90
    assert len(re.findall(r"(?<!!)\[[^]]+\]\((?!https?:)", README)) == 6
    assert len(re.findall(r"!\[", README)) == 1
    assert len(re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1).splitlines()) <= 12
