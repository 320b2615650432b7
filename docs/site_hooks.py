"""What MkDocs calls while it builds the site: the generated pages are put in."""

from __future__ import annotations

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from reference_pages import PAGES

ROOT = Path(__file__).resolve().parents[1]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put in the pages of the reference, for which signposts stand, and the changelog from beside the README."""
    for path, page in PAGES.items():
        signpost = files.get_file_from_path(path)
        if signpost is not None:
            files.remove(signpost)
        files.append(File.generated(config, path, content=page()))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "changes.md", content=changes))
    return files
