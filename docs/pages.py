"""Pages of the site that are made from files elsewhere in the repository, and the index of its search (a hook of
MkDocs; `make docs`)."""

import ast
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the README as the first page, the other documents of the root, and a page of the examples."""
    readme = (ROOT / "README.md").read_text().replace("](docs/examples)", "](examples.md)").replace("](docs/", "](")
    pages = {"index.md": readme, "examples.md": examples()}
    pages |= {name: (ROOT / name).read_text() for name in ("CONTRIBUTING.md", "CHANGELOG.md")}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_post_build(config: MkDocsConfig) -> None:
    """Write the index of the search as a script too, for search_from_file.js."""
    folder = Path(config.site_dir) / "search"
    (folder / "search_index.js").write_text(f"const SEARCH_INDEX = {(folder / 'search_index.json').read_text()};\n")


def examples() -> str:
    """A section for each script of docs/examples: the first line of its docstring, then the code below it."""
    sections = ["# Examples in Python\n\nIn rising difficulty; each runs as it is.\n"]
    for file in sorted((ROOT / "docs" / "examples").glob("*.py")):
        source = file.read_text()
        title, _, code = source.partition("\n")
        sections.append(
            f"## {ast.literal_eval(title)}\n\n`{file.relative_to(ROOT)}`\n\n```python\n{code.strip()}\n```\n"
        )
    return "\n".join(sections)
