"""How this package draws: nothing else in it sets matplotlib up. Scripts load this file by itself, so it needs no other."""
import importlib
from typing import Any, BinaryIO, Dict, Iterable

COLOURS = ["#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#17becf", "#bcbd22", "#7f7f7f", "#e377c2"]
REPORT = {"axes.titlesize": 11}
PRINTED = {"pdf.fonttype": 42, "path.simplify": False, "lines.scale_dashes": False}  # text stays text, lines are as wide as told


def __getattr__(part: str) -> Any:
    """A module of matplotlib, imported at its first use: a report is read and a rig measured without it."""
    if part not in ("animation", "colors", "font_manager", "patches", "path", "textpath", "ticker", "transforms"):
        raise AttributeError(f"module {__name__} has no attribute {part}")
    return importlib.import_module(f"matplotlib.{part}")


def use(settings: Dict[str, Any]) -> None:
    """Sets the style of this process, such as REPORT. Raises ImportError without matplotlib, as all below do."""
    importlib.import_module("matplotlib").rcParams.update(settings)


def page(width: float, height: float, **options: Any) -> Any:
    """An empty figure [inch]. Without pyplot, which keeps figures and asks for a display."""
    return importlib.import_module("matplotlib.figure").Figure(figsize=(width, height), **options)


def add_grid(axes: Any) -> None:
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def plain(text: str) -> str:
    """Text with $ escaped, which would begin a formula."""
    return text.replace("$", r"\$")


def save_pdf(file: BinaryIO, pages: Iterable[Any], title: str, writer: str) -> None:
    """Without a date, so that the same pages give the same file."""
    with importlib.import_module("matplotlib.backends.backend_pdf").PdfPages(
            file, metadata={"Title": title, "Creator": writer, "CreationDate": None}) as pdf:
        for one in pages:
            pdf.savefig(one)
