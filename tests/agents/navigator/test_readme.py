"""What the page on safety claims is tested where it says."""

from __future__ import annotations

import re
from pathlib import Path

import agents.navigator

FOLDER = Path(__file__).parent
NAMED = re.compile(r"`(test_\w+\.py)::(test_\w+)`")


def test_every_test_that_the_page_names_is_there() -> None:
    page = Path(agents.navigator.__file__).with_name("README.md").read_text()
    named = NAMED.findall(page)
    assert len(named) >= 7
    for file, test in named:
        assert f"def {test}(" in (FOLDER / file).read_text(), f"{file}::{test}"


def test_every_module_is_on_the_page() -> None:
    page = Path(agents.navigator.__file__).with_name("README.md").read_text()
    modules = {path.stem for path in Path(agents.navigator.__file__).parent.glob("*.py")}
    missing = {name for name in modules if f"`{name}`" not in page}
    assert missing == {"__init__", "aim", "compiled", "warm"}
