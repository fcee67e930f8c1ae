"""One protocol for all studies: settings -> run -> document -> page.

A study has settings (arguments of its function, options of its command), a run whose result is a
record, a document (the result's figures, rounded, as report.json holds them) and a page. What they
have in common after the run is here: the output folder, its files and the order of writing them. A
study's module `report` has its `STUDY`, its pictures, and the content of its documents.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from ambinav.plotting.style import FORMATS
from ambinav.reports.page.html import fill_page
from ambinav.reports.pages import data_uri, fill
from ambinav.runtime.files import replacing, write_text
from ambinav.runtime.progress import Progress, silent
from ambinav.runtime.runfolder import WORK, RunFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Figures = Mapping[str, Callable[[], "Axes | Figure"]]
"""The drawing functions of pictures, by name without suffix."""


@dataclass(frozen=True)
class Content:
    """Content of the documents of a result.

    Attributes:
        report: The figures, as the JSON document holds them.
        values: What the templates need beside `report` and `pictures`.
        filters: Template filters by name, besides those of `ambinav.reports.pages.fill`.
        page_map: Map data of the page (`ambinav.reports.page.map_data`); None: a page without map.
        files: Texts of further files by name.
    """

    report: BaseModel | Mapping[str, Any]
    values: Mapping[str, Any] = field(default_factory=dict)
    filters: Mapping[str, Callable[..., str]] = field(default_factory=dict)
    page_map: Mapping[str, Any] | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def json(self) -> str:
        """The figures as JSON."""
        if isinstance(self.report, BaseModel):
            return self.report.model_dump_json(indent=2) + "\n"
        return json.dumps(self.report, indent=2, default=str) + "\n"


@dataclass(frozen=True)
class Study:
    """A kind of study: what its output folder holds, and how that is written.

    Attributes:
        kind: What messages call what an earlier run left in a folder, such as "placement".
        package: The package whose folder templates has report.md.j2, and report.html.j2 or, for a
            page with a map, page.html.j2.
        pictures: Names of the pictures without suffix, as patterns.
        files: Names of further files, as patterns.
        format: Format of the JSON document, such as "ambinav-diff/1": this file shows that a folder
            is of an earlier run, which is replaced as a whole. Empty: results are added to those of
            an earlier run, of which the folder `work` keeps all that can be used again.
        stem: Name of the documents without suffix.
        documents: Suffixes of the documents.
    """

    kind: str
    package: str
    pictures: tuple[str, ...]
    files: tuple[str, ...] = ()
    format: str = ""
    stem: str = "report"
    documents: tuple[str, ...] = ("json", "html", "md")

    @property
    def json(self) -> str:
        """File name of the figures."""
        return f"{self.stem}.json"

    @property
    def html(self) -> str:
        """File name of the page."""
        return f"{self.stem}.html"

    def page(self, output: Path | None) -> Path | None:
        """Return the path of the page of a report in a folder; None: there is no folder."""
        return None if output is None else output / self.html

    @property
    def markdown(self) -> str:
        """File name of the report as text."""
        return f"{self.stem}.md"

    @property
    def folder(self) -> RunFolder:
        """Rules for the output folder."""
        documents = (f"{self.stem}.{suffix}" for suffix in self.documents)
        proof = self.json if self.format else ""
        names = (*documents, *self.files, *self._picture_names, *(() if self.format else (WORK,)))
        return RunFolder(self.kind, names, proof=proof, format=self.format.split("/")[0])

    def write(
        self,
        folder: str | Path,
        content: Content,
        figures: Figures,
        image_format: str = "png",
        progress: Progress = silent,
        more: Callable[[Path], object] | None = None,
    ) -> None:
        """Write a result atomically; an earlier one in `folder` is replaced.

        Args:
            folder: Output folder.
            content: The content of the documents.
            figures: The pictures.
            image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
            progress: Called with the fraction of the pictures done.
            more: Writes further files into the folder that it is given.

        Raises:
            InputError: see `RunFolder.check`; or the place is not writable.
        """
        path = self.folder.check(folder).absolute()
        with replacing(path) as fresh:
            fresh.mkdir()
            names = self.draw(fresh, figures, image_format, progress)
            if more is not None:
                more(fresh)
            self.write_documents(fresh, content, names)

    def draw(
        self, folder: Path, figures: Figures, image_format: str, progress: Progress = silent
    ) -> dict[str, str]:
        """Draw pictures into a folder, each completely or not at all; return their file names."""
        from ambinav.plotting.canvas import save_figure

        names = {name: f"{name}.{image_format}" for name in figures}
        for done, (name, figure) in enumerate(figures.items(), start=1):
            save_figure(figure(), folder / names[name])
            progress(done / len(figures))
        return names

    def write_documents(
        self, folder: Path, content: Content, pictures: Mapping[str, str], *, page: bool = True
    ) -> None:
        """Write the documents and further files into a folder that has the pictures.

        Args:
            folder: An existing folder.
            content: What they say.
            pictures: File names of the pictures, by the names that the templates use.
            page: Whether to write the page; it shows the pictures without needing their files.
        """
        texts = {**content.files, self.markdown: self.fill("report.md.j2", content, pictures)}
        if page and "html" in self.documents:
            inlined = {name: data_uri(folder / file) for name, file in pictures.items()}
            template = "report.html.j2" if content.page_map is None else "page.html.j2"
            texts[self.html] = self.fill(template, content, inlined)
        # The last one: where it is, all others are.
        texts[self.json] = content.json
        for name, text in texts.items():
            write_text(folder / name, text)

    def fill(self, template: str, content: Content, pictures: Mapping[str, str]) -> str:
        """Fill a template of the study."""
        values = {"report": content.report, "pictures": pictures, **content.values}
        if template == "page.html.j2" and content.page_map is not None:
            return fill_page(self.package, template, content.page_map, content.filters, **values)
        return fill(self.package, template, content.filters, **values)

    def is_picture(self, name: str) -> bool:
        """Return whether a file name is one that the pictures of the study may have."""
        return any(fnmatchcase(name, pattern) for pattern in self._picture_names)

    def remove_pictures(self, folder: Path, kept: Collection[str]) -> None:
        """Remove the pictures of an earlier run from a folder, but for the files that are kept."""
        for path in folder.iterdir():
            if self.is_picture(path.name) and path.name not in kept:
                path.unlink()

    @property
    def _picture_names(self) -> list[str]:
        return [f"{name}.{suffix}" for suffix in FORMATS for name in self.pictures]
