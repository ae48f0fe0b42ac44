"""Every name in the glossary exists."""

import re
from importlib import import_module
from pathlib import Path

import pytest

GLOSSARY = Path(__file__).parents[1] / "docs" / "glossary.md"
NAMES = sorted(set(re.findall(r"`((?:pps_vision|tracking|learning|control|rendering)\.[\w.]+)`", GLOSSARY.read_text())))


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_glossary_exists(name):
    module, _, attribute = name.rpartition(".")
    if attribute[0].isupper():
        assert hasattr(import_module(module), attribute)
    else:
        import_module(name)
