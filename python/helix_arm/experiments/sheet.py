"""The data sheet: a page for the wall, tables of all figures, and plots, as PDF; the same as HTML."""
from __future__ import annotations

import base64
import html
import io
import math
import textwrap
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from helix_arm import drawing
from helix_arm.experiments.figures import NORMAL, Figure
from helix_arm.experiments.protocol import Analysis, Plot

PAGE = (8.27, 11.69)  # A4 [inch]
LEFT, RIGHT, BOTTOM = 0.07, 0.93, 0.05
MOST_ROWS, MOST_COLUMNS, MOST_PLOTS = 56, 4, 12  # of a page
NOTE = f"Value ± standard error; value ± {NORMAL:.2f} standard errors is the 95 % interval."
# Figures of the first page: how their names begin, without that of the actuator.
MAIN = ("up dead time, pressure", "up 63 % time, tip", "up overshoot, tip", "frequency", "damping ratio", "stroke", "loop width", "play",
        "-3 dB frequency", "creep of the step", "P1 accuracy", "P1 repeatability", "path accuracy", "stiffness along x at 20 %",
        "stiffness along y at 20 %", "stiffness along z at 20 %", "shift by a payload", "model error")
MAIN_PLOTS = ("response", "hysteresis", "Gain of tip by command", "Phase of tip by command")  # ends of their titles

Header = Sequence[Tuple[str, str]]
Sections = Sequence[Tuple[str, Analysis]]  # by the names of experiments
Rows = Dict[str, Dict[str, Figure]]  # figures by name, then by actuator; "" of the whole arm


def title_of(header: Header) -> str:
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


def rows_of(figures: Sequence[Figure], actuators: Sequence[str]) -> Rows:
    rows: Rows = {}
    for one in figures:
        who, _, rest = one.name.partition(" ")
        name, column = (rest, who) if who in actuators else (one.name, "")
        rows.setdefault(name, {})[column] = one
    return rows


def _columns(rows: Rows) -> List[str]:
    return list(dict.fromkeys(column for row in rows.values() for column in row if column)) or [""]


def _cells(row: Dict[str, Figure], columns: Sequence[str]) -> List[str]:
    """One per column; of a figure of the whole arm, or of more actuators than fit, all in the first."""
    if len(columns) <= MOST_COLUMNS:
        return [value_text(row[one]) if one in row else "" for one in (columns if "" not in row else [""])]
    known = sorted((one for one in row.values() if one.value is not None), key=lambda one: one.value or 0.0)
    return [f"{value_text(known[0])} to {value_text(known[-1])}" if len(known) > 1 else value_text(next(iter(row.values())))]


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


def _table(page: Any, rows: Rows, top: float, height: float, size: float) -> None:
    """With the definition below each row where there is room for it."""
    columns = _columns(rows)
    ends = np.linspace(RIGHT, 0.36, len(columns[:MOST_COLUMNS]), endpoint=False)[::-1]
    if len(columns) <= MOST_COLUMNS:
        for end, name in zip(ends, columns):
            page.text(end, top, name, fontsize=size, ha="right", color="#555555")
    for i, (name, row) in enumerate(rows.items()):
        up, first = top - height * (i + 1), next(iter(row.values()))
        page.text(LEFT, up, f"{name} ({first.symbol})" if first.symbol else name, fontsize=size)
        for end, text in zip(ends, _cells(row, columns)):
            page.text(end, up, text, fontsize=size, ha="right", color="#999999" if text == "not identifiable" else "#000000")
        if height > 0.02:
            page.text(LEFT, up - 0.42 * height, textwrap.shorten(first.definition, 160, placeholder=" .."), fontsize=0.65 * size,
                      color="#555555")


def _first_page(header: Header, sections: Sections, actuators: Sequence[str], picture: Optional[np.ndarray]) -> Any:
    page = drawing.page(*PAGE)
    page.text(LEFT, 0.95, title_of(header), fontsize=20)
    for i, (name, text) in enumerate(header):
        page.text(LEFT, 0.92 - 0.018 * i, name, fontsize=8, color="#555555")
        page.text(0.2, 0.92 - 0.018 * i, text[:62], fontsize=8)
    page.text(LEFT, 0.92 - 0.018 * len(header), NOTE, fontsize=7)
    if picture is not None:
        axes = page.add_axes((0.66, 0.785, 0.27, 0.15))
        axes.imshow(picture, cmap="gray")
        axes.set_axis_off()
    every = rows_of([one for _, part in sections for one in part.figures], actuators)
    found = [next((name for name in every if name.startswith(begin)), "") for begin in MAIN]
    main = {name: every[name] for name in found if name} or dict(list(every.items())[:len(MAIN)])
    _table(page, main, 0.765, 0.0285, 9.5)
    plots = [plot for _, part in sections for plot in part.plots]
    chosen = [next((plot for plot in plots if plot.title.endswith(end)), None) for end in MAIN_PLOTS]
    places = ((LEFT, BOTTOM, 0.24, 0.145), (0.38, BOTTOM, 0.24, 0.145), (0.69, 0.135, 0.24, 0.06), (0.69, BOTTOM, 0.24, 0.06))
    for plot, place in zip(chosen, places):
        if plot is not None:
            _draw(page.add_axes(place), plot, 6)
    return page


def _table_pages(sections: Sections, actuators: Sequence[str]) -> List[Any]:
    pages = []
    for name, part in sections:
        rows = list(rows_of(part.figures, actuators).items())
        for begin in range(0, len(rows), MOST_ROWS):
            page = drawing.page(*PAGE)
            page.text(LEFT, 0.95, f"{name}: all figures", fontsize=14)
            _table(page, dict(rows[begin:begin + MOST_ROWS]), 0.92, 0.0155, 7.5)
            pages.append(page)
    return pages


def _plot_pages(plots: Sequence[Plot]) -> List[Any]:
    pages = []
    for begin in range(0, len(plots), MOST_PLOTS):
        page = drawing.page(*PAGE)
        for i, plot in enumerate(plots[begin:begin + MOST_PLOTS]):
            _draw(page.add_subplot(4, 3, i + 1), plot, 5.5)
        page.tight_layout(pad=2.0)
        pages.append(page)
    return pages


def pdf_of(header: Header, sections: Sections, actuators: Sequence[str], picture: Optional[np.ndarray] = None) -> bytes:
    file = io.BytesIO()
    pages = [_first_page(header, sections, actuators, picture), *_table_pages(sections, actuators),
             *_plot_pages([plot for _, part in sections for plot in part.plots])]
    drawing.save_pdf(file, pages, title_of(header), "helix_arm")
    return file.getvalue()


def html_of(header: Header, sections: Sections, actuators: Sequence[str]) -> str:
    """One file, with its pictures."""
    text = ["<!DOCTYPE html><html lang=en><meta charset=utf-8><title>Data sheet</title><style>body{font:14px sans-serif;max-width:70em;"
            "margin:2em auto}td,th{padding:.1em .8em;text-align:left;vertical-align:top}td.n{text-align:right;white-space:nowrap}"
            "img{width:32%}small{color:#555}</style>", f"<h1>{html.escape(title_of(header))}</h1><table>"]
    text += [f"<tr><th>{html.escape(name)}<td>{html.escape(value)}" for name, value in header]
    text.append(f"</table><p>{html.escape(NOTE)}")
    for name, part in sections:
        rows = rows_of(part.figures, actuators)
        columns = _columns(rows)
        titles = "".join(f"<th>{html.escape(one or 'value')}" for one in columns)
        text.append(f"<h2>{html.escape(name)}</h2><table><tr><th>figure<th>symbol{titles}<th>definition")
        for figure, row in rows.items():
            first = next(iter(row.values()))
            values = "".join(f"<td class=n>{html.escape(value_text(row[one])) if one in row else ''}" for one in columns)
            if "" in row and columns != [""]:
                values = f"<td class=n colspan={len(columns)}>{html.escape(value_text(row['']))}"
            text.append(f"<tr><td>{html.escape(figure)}<td>{html.escape(first.symbol)}{values}"
                        f"<td><small>{html.escape(first.definition)}</small>")
        text.append("</table>")
        for plot in part.plots:
            drawn, picture = drawing.page(4.2, 3.0), io.BytesIO()
            _draw(drawn.add_subplot(1, 1, 1), plot, 8)
            drawn.tight_layout()
            drawn.savefig(picture, format="png", dpi=110)
            content = base64.b64encode(picture.getvalue()).decode()
            text.append(f"<img alt=\"{html.escape(plot.title)}\" src=\"data:image/png;base64,{content}\">")
    return "\n".join(text) + "</html>\n"
