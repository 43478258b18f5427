"""The data sheet: two pages of PDF, and the same as HTML."""
from __future__ import annotations

import base64
import html
import io
import math
from typing import Any, Dict, List, Tuple

from helix_arm import drawing
from helix_arm.experiments.figures import NORMAL, Figure
from helix_arm.experiments.protocol import Analysis, Plot

PAGE = (8.27, 11.69)  # A4 [inch]
COLUMNS, MOST_ROWS, ROW = 2, 84, 0.16  # of the table on a page: columns, rows in each, highest row [inch]
MOST_PLOTS = 12
NOTE = f"value +- standard error; value +- {NORMAL:.2f} standard errors is the 95 % interval. Definitions: docs/experiments.md"


def title_of(header: List[Tuple[str, str]]) -> str:
    return f"Data sheet of {dict(header).get('scene', 'recordings')}"


def value_text(figure: Figure) -> str:
    """As in "1.234 +- 0.012 mm": two digits of the error."""
    if figure.value is None or figure.standard_error is None:
        return "not identifiable"
    unit = "" if figure.unit == "1" else f" {figure.unit}"
    if not figure.standard_error > 0 or not math.isfinite(figure.standard_error):
        return f"{figure.value:.4g}{unit}"
    places = max(0, 1 - math.floor(math.log10(figure.standard_error)))
    return f"{figure.value:.{places}f} +- {figure.standard_error:.{places}f}{unit}"


def header_of(document: Dict[str, Any], conditions: str) -> List[Tuple[str, str]]:
    rows = [("experiment", document["experiment"]), ("scene", document["scene"]), ("sha256 of the scene", document["scene_sha256"]),
            ("measured", f"{document['date']}, helix_arm {document['version']}"), ("conditions", conditions),
            ("stopped", document["ended"])]
    return [(name, text) for name, text in rows if text]


def _draw(axes: Any, plot: Plot, size: float) -> None:
    colours = drawing.COLOURS
    for i, curve in enumerate(plot.curves):
        axes.plot(curve.x, curve.y, curve.style, color=colours[i % len(colours)], linewidth=0.9, markersize=2.5, label=curve.label)
    if plot.log:
        axes.set_xscale("log")
    axes.set_title(plot.title, fontsize=size + 1)
    axes.set_xlabel(plot.x, fontsize=size)
    axes.set_ylabel(plot.y, fontsize=size)
    axes.tick_params(labelsize=size)
    drawing.add_grid(axes)
    if 1 < len(plot.curves) <= len(colours):
        axes.legend(fontsize=size - 0.5, frameon=False)


def _table_page(header: List[Tuple[str, str]], analysis: Analysis) -> Any:
    page = drawing.page(*PAGE)
    page.text(0.07, 0.955, title_of(header), fontsize=15)
    for i, (name, text) in enumerate(header):
        page.text(0.07, 0.93 - 0.015 * i, name, fontsize=7, color="#555555")
        page.text(0.25, 0.93 - 0.015 * i, text[:110], fontsize=7)
    top = 0.91 - 0.015 * len(header)
    rows = analysis.figures[:COLUMNS * MOST_ROWS]
    long = max(math.ceil(len(rows) / COLUMNS), 1)
    height = min(ROW / PAGE[1], (top - 0.06) / long)
    size = min(7.0, 0.8 * 72 * height * PAGE[1])
    for i, one in enumerate(rows):
        left, up = 0.07 + 0.45 * (i // long), top - height * (i % long)
        page.text(left, up, one.name, fontsize=size)
        colour = "#999999" if one.value is None else "#000000"
        page.text(left + 0.42, up, value_text(one), fontsize=size, ha="right", color=colour)
    left_out = len(analysis.figures) - len(rows)
    page.text(0.07, 0.035, NOTE + (f"; {left_out} more figures are in the JSON" if left_out else ""), fontsize=6)
    return page


def _plot_page(analysis: Analysis) -> Any:
    plots = analysis.plots[:MOST_PLOTS]
    page = drawing.page(*PAGE)
    across = 2 if len(plots) <= 6 else 3
    down = max(math.ceil(len(plots) / across), 3)
    for i, plot in enumerate(plots):
        _draw(page.add_subplot(down, across, i + 1), plot, 5.5)
    page.tight_layout(pad=2.0)
    return page


def pdf_of(header: List[Tuple[str, str]], analysis: Analysis) -> bytes:
    file = io.BytesIO()
    drawing.save_pdf(file, (_table_page(header, analysis), _plot_page(analysis)), title_of(header), "helix_arm")
    return file.getvalue()


def html_of(header: List[Tuple[str, str]], analysis: Analysis) -> str:
    """One file, with its pictures."""
    text = ["<!DOCTYPE html><html lang=en><meta charset=utf-8><title>Data sheet</title><style>body{font:14px sans-serif;max-width:70em;"
            "margin:2em auto}td,th{padding:.1em .8em;text-align:left;vertical-align:top}td.n{text-align:right;white-space:nowrap}"
            "img{width:32%}small{color:#555}</style>", f"<h1>{html.escape(title_of(header))}</h1><table>"]
    text += [f"<tr><th>{html.escape(name)}<td>{html.escape(value)}" for name, value in header]
    text.append("</table><h2>Figures</h2><table><tr><th>figure<th>symbol<th>value<th>definition")
    for one in analysis.figures:
        cells = [html.escape(cell) for cell in (one.name, one.symbol, value_text(one), one.definition)]
        text.append(f"<tr><td>{cells[0]}<td>{cells[1]}<td class=n>{cells[2]}<td><small>{cells[3]}</small>")
    text.append(f"</table><p>{html.escape(NOTE)}</p><h2>Plots</h2>")
    for plot in analysis.plots:
        drawn, picture = drawing.page(4.2, 3.0), io.BytesIO()
        _draw(drawn.add_subplot(1, 1, 1), plot, 8)
        drawn.tight_layout()
        drawn.savefig(picture, format="png", dpi=110)
        content = base64.b64encode(picture.getvalue()).decode()
        text.append(f"<img alt=\"{html.escape(plot.title)}\" src=\"data:image/png;base64,{content}\">")
    return "\n".join(text) + "</html>\n"
