"""The pages of `helix_arm tags`: laid out, and printed at their exact size.

Lengths are in mm on paper; positions count from the top left corner of the page, x to the right and y down.
"""

import math
import re
from typing import NamedTuple

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}
MARGIN = 10.0  # that stays empty: many printers cannot print there
TEXT, LINE = 3.2, 3.6  # height of text of the usual size, and from one line of it to the next
HEADING, FOOTER = 15.0, 13.0
RULER_COLUMN, RULER = 11.0, 100  # width of the column of the upright ruler, length of rulers
LEFT, CENTRE, RIGHT = 0.0, 0.5, 1.0
POINT = 72 / 25.4  # in a millimetre
FONT_SIZE, BASELINE = 0.84, 0.79  # of a printed line, as fractions of its height

GAP = 3.0  # between cards
RIM = 1.5  # around a card's tag: room for marks, and for inaccurate cuts
MARK = 1.0  # size of the marks in it
STRIP = 5.0  # below the card, for its text
LEAST_BIT = 0.5  # of a marker: 2 pixels of a usual webcam at 0.25 m

MAP_HEIGHT, TITLE_HEIGHT, ROW_HEIGHT, SECTION_GAP = 72.0, 4.6, 4.2, 6.0  # of the pages of the mounting
NAMES, SCALE, EDGE = 32.0, 6.0, 7.0  # of a map: for names of muscles, below for s, beside the first and last s
COLUMNS = [  # title, part of the page's width, meaning
    ("id", 0.06, "the number on the tag's strip"),
    ("s", 0.08, "place along the section, 0 at its base, 1 at its end: of its centre line and of each muscle"),
    ("from base", 0.12, "the same along the centre line [mm]"),
    ("muscle", 0.2, "the nearest one"),
    ("angle", 0.1, "around the centre line, from its y axis (first muscle of a ring) towards z [deg]"),
    ("radius", 0.1, "from the centre line to the middle of the tag [mm]"),
    ("stand-off", 0.11, "from the middle of the muscle to the middle of the tag, outwards [mm]"),
    ("aside", 0.09, "the same towards larger angles [mm]"),
    ("turn", 0.07, "of the up mark from upwards as drawn here, counter-clockwise [deg]"),
    ("tilt", 0.07, "between where the tag faces and outwards [deg]"),
]
ACTUAL_SIZE = 'Print at 100 % ("actual size"), on matt paper. '


class Refused(Exception):
    """A part that does not fit on the paper, with its rule."""


class Box(NamedTuple):
    x: float
    y: float
    width: float
    height: float

    right = property(lambda self: self.x + self.width)
    bottom = property(lambda self: self.y + self.height)
    corners = property(lambda self: [(self.x, self.y), (self.right, self.y), (self.right, self.bottom), (self.x, self.bottom)])


class Paper:
    def __init__(self, name):
        self.name, (width, height) = name, PAPERS[name]
        self.size = width, height
        self.area = Box(MARGIN, MARGIN, width - 2 * MARGIN, height - 2 * MARGIN)
        # Space that the heading and the rulers leave.
        self.free = Box(MARGIN + RULER_COLUMN, MARGIN + HEADING, self.area.width - RULER_COLUMN,
                        self.area.height - HEADING - FOOTER)


class Page:
    """Begins with a title and up to two lines of notes."""

    def __init__(self, paper, title, notes):
        self.strokes = {}  # ends of straight lines, by (width, gray, dashed)
        self.areas = []  # (gray, corners) of polygons above the strokes
        self.black = []  # boxes above the areas
        self.labels = []  # (box, text, align, bold): a line of text, made smaller where it would be wider
        area = paper.area
        self.write((area.x, area.y, area.width - 30.0, 5.5), title, bold=True)
        self.write_lines(notes, area.x, area.y + 6.1, area.width)

    def write(self, box, text, align=LEFT, bold=False):
        self.labels.append((Box(*box), text, align, bold))

    def write_lines(self, lines, x, y, width):
        for i, line in enumerate(lines):
            self.write((x, y + i * LINE, width, TEXT), line)

    def stroke(self, start, end, width=0.15, gray=0.0, dashed=False):
        self.strokes.setdefault((width, gray, dashed), []).append((start, end))

    def outline(self, box):
        for i, corner in enumerate(box.corners):
            self.stroke(box.corners[i - 1], corner, 0.15, 0.4)

    def up_mark(self, middle, size, angle=0.0):
        """A triangle about the middle of its height; angle: counter-clockwise from upwards [rad]."""
        corners = [(0, 0.5 * size), (0.6 * size, -0.5 * size), (-0.6 * size, -0.5 * size)]
        self.areas.append((0.0, turned(middle, angle, corners)))

    def cells(self, rows, corner, side):
        """Black cells (#) of a grid that begins in this corner, each with this side."""
        for i, row in enumerate(rows):
            for run in re.finditer("#+", row):
                self.black.append(Box(corner[0] + run.start() * side, corner[1] + i * side, len(run.group()) * side, side))

    def rulers(self, paper, notes):
        """One across and one upright, and notes beside them."""
        x, bottom = paper.free.x, paper.free.bottom
        for i in range(RULER + 1):
            tick = 4.5 if i % 10 == 0 else 3.2 if i % 5 == 0 else 2.0
            self.stroke((x + i, bottom + 4.0), (x + i, bottom + 4.0 + tick), 0.1)
            self.stroke((x - 1.5, bottom - i), (x - 1.5 - tick, bottom - i), 0.1)
            if i % 10 == 0:
                last = i == RULER
                half = 4.9 if last else 3.0
                self.write((x + i - half, bottom + 8.8, 2 * half, 2.6), f"{i} mm" if last else str(i), CENTRE)
                self.write((MARGIN, bottom - i - 1.3, x - 6.3 - MARGIN, 2.6), str(i), RIGHT)
        self.stroke((x, bottom + 4.0), (x + RULER, bottom + 4.0), 0.1)
        self.stroke((x - 1.5, bottom), (x - 1.5, bottom - RULER), 0.1)
        self.write_lines(notes, x + RULER + 8.0, bottom + 2.0, paper.free.width - RULER - 8.0)


def turned(middle, angle, points):
    """Points (right, up) from a middle, turned counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    return [(middle[0] + right * c - up * s, middle[1] - right * s - up * c) for right, up in points]


def rounded(value, digits):
    """With up to so many decimals, without zeros at its end."""
    text = f"{value:.{digits}f}"
    text = text.rstrip("0").rstrip(".") if digits else text
    return "0" if text == "-0" else text


def mm(length, digits=2):
    return rounded(1e3 * length, digits) + " mm"


def degrees(angle):
    text = rounded(math.degrees(angle), 1)
    return "0" if text == "360" else text


def card_pages(arm, paper):
    """The tags to cut out, each at its exact size with id, place on the arm, up mark and cut line."""
    side, border = 1e3 * arm["size_m"], arm["border_cells"]
    count = len(arm["tags"][0]["cells"])
    cell = side / border
    card = cell * count + 2 * RIM
    most = min(paper.free.width, paper.free.height - STRIP)
    if card > most:
        raise Refused(f"tags.size_m is {repr(arm['size_m']).removesuffix('.0')}: with its border a {arm['family']} tag is "
                      f"{rounded(card, 1)} mm wide, but {paper.name} has room for {rounded(most, 1)} mm; expected at most "
                      f"{rounded(math.floor((most - 2 * RIM) / count * border) / 1e3, 3)} m. Print smaller tags")
    columns = int((paper.free.width + GAP) / (card + GAP))
    rows = int((paper.free.height + GAP) / (card + STRIP + GAP))
    pages = []
    for i, tag in enumerate(arm["tags"]):
        row, column = divmod(i % (columns * rows), columns)
        if (row, column) == (0, 0):
            pages.append(Page(paper, f"{arm['scene']}: tags {arm['family']} of {mm(arm['size_m'])}", [
                ACTUAL_SIZE + "Check both rulers, then cut along the solid lines.",
                "The triangle marks the upper edge, the lines the middle of the other edges. Fold the strip "
                "back or cut it off."]))
            pages[-1].rulers(paper, ["Both rulers must be 100 mm long on paper. If not,",
                                     "print again without scaling; or give as tags.size_m the",
                                     "side of the " + arm["size_edge"] + "."])
        x, y = paper.free.x + column * (card + GAP), paper.free.y + row * (card + STRIP + GAP)
        pages[-1].cells(tag["cells"], (x + RIM, y + RIM), cell)
        section = arm["sections"][tag["section"]]["name"] + ", " if len(arm["sections"]) > 1 else ""
        add_card(pages[-1], Box(x, y, card, card), str(tag["id"]), f"{section}{tag['muscle']}, s {rounded(tag['s'], 4)}")
    return pages


def add_card(page, card, name, place):
    """Outline, marks in the middle of the sides (a triangle at the top, else lines), and the strip below the dashed line."""
    x, y = card.x + 0.5 * card.width, card.y + 0.5 * card.height
    page.outline(Box(card.x, card.y, card.width, card.height + STRIP))
    page.up_mark((x, card.y + 0.2 + 0.5 * MARK), MARK)
    page.stroke((card.x, y), (card.x + MARK, y))
    page.stroke((card.right - MARK, y), (card.right, y))
    page.stroke((x, card.bottom - MARK), (x, card.bottom))
    page.stroke((card.x, card.bottom), (card.right, card.bottom), 0.15, 0.4, True)
    pad = 0.8
    width, height = card.width - 3 * pad, STRIP - 2 * pad
    page.write((card.x + pad, card.bottom + pad, 0.25 * width, height), name, bold=True)
    page.write((card.x + 2 * pad + 0.25 * width, card.bottom + pad + 0.3, 0.75 * width, height - 0.6), place, RIGHT)


class Mounting:
    """Where the tags are mounted: a drawing and a table for each section that has tags, from the top down."""

    def __init__(self, arm, paper):
        self.arm, self.paper, self.pages = arm, paper, []
        self.begin_page()
        for title, _, meaning in COLUMNS:
            self.pages[-1].write((paper.area.x, self.y, 20.0, TEXT), title, bold=True)
            self.pages[-1].write((paper.area.x + 20.0, self.y, paper.area.width - 20.0, TEXT), meaning)
            self.y += LINE
        self.y += TEXT
        for i, section in enumerate(arm["sections"]):
            tags = [tag for tag in arm["tags"] if tag["section"] == i]
            if tags:
                self.add_section(section, tags)

    def begin_page(self):
        self.pages.append(Page(self.paper, f"{self.arm['scene']}: where the tags are mounted",
                               ["The arm at rest as if its skin were unrolled, seen from outside. Not to scale."]))
        self.y = self.paper.free.y  # where the next part begins

    def room_left(self):
        return self.paper.area.bottom - self.y

    def add_section(self, section, tags):
        if self.room_left() < TITLE_HEIGHT + MAP_HEIGHT + 3 * ROW_HEIGHT:
            self.begin_page()
        area = self.paper.area
        self.pages[-1].write((area.x, self.y, area.width, TITLE_HEIGHT),
                             f"Section {section['name']}, {mm(section['length_m'], 1)} long at rest", bold=True)
        self.y += TITLE_HEIGHT + 1.0
        add_map(self.pages[-1], section, tags, Box(area.x + NAMES, self.y, area.width - NAMES, MAP_HEIGHT - SCALE))
        self.y += MAP_HEIGHT + 1.0
        self.add_table(tags)
        self.y += SECTION_GAP

    def add_table(self, tags):
        begun = False
        for tag in tags:
            if self.room_left() < 2 * ROW_HEIGHT:
                self.begin_page()
                begun = False
            if not begun:
                self.add_row([title for title, _, _ in COLUMNS], True)
                begun = True
            lengths = [rounded(1e3 * tag[key], 1) for key in ("from_base_m", "radius_m", "standoff_m", "aside_m")]
            self.add_row([str(tag["id"]), rounded(tag["s"], 4), lengths[0], tag["muscle"], degrees(tag["angle"]), *lengths[1:],
                          degrees(tag["turn"]), degrees(tag["tilt"])], False)

    def add_row(self, cells, bold):
        area, page = self.paper.area, self.pages[-1]
        x = area.x
        for text, (_, part, _) in zip(cells, COLUMNS):
            page.write((x, self.y, part * area.width - 1.0, TEXT), text, RIGHT, bold)
            x += part * area.width
        self.y += ROW_HEIGHT
        page.stroke((area.x, self.y - 0.5), (area.right, self.y - 0.5), 0.1, 0.0 if bold else 0.8)


def cut_of(angles):
    """Where the skin is cut open: in the middle of the widest strip without tags or muscles, preferably before angle 0."""
    angles = sorted(angles)
    gaps = [(angles[i] - angles[i - 1]) % math.tau or (math.tau if len(set(angles)) == 1 else 0.0) for i in range(len(angles))]
    widest = next(i for i, gap in enumerate(gaps) if gap > max(gaps) - 1e-3)
    return angles[widest] - 0.5 * gaps[widest]


def add_map(page, section, tags, field):
    """A section as if its skin were unrolled and seen from outside.

    Its base is on the left, angles grow downwards. A line per muscle; a square per tag, with its id and up mark.
    """
    cut = cut_of([tag["angle"] for tag in tags] + [muscle["angle"] for muscle in section["muscles"]])

    def at(s, angle):
        return field.x + EDGE + s * (field.width - 2 * EDGE), field.y + (angle - cut) % math.tau / math.tau * field.height

    page.outline(field)
    height = min(TEXT, 0.9 * field.height / len(section["muscles"]))
    for muscle in section["muscles"]:
        y = at(0, muscle["angle"])[1]
        page.stroke((field.x, y), (field.right, y), 0.2, 0.6)
        page.write((field.x - NAMES, y - 0.5 * height, NAMES - 2.0, height),
                   f"{muscle['name']}, {rounded(math.degrees(muscle['angle']), 1)} deg", RIGHT)
    for s, end in ((0.0, "base, "), (0.25, ""), (0.5, ""), (0.75, ""), (1.0, "end, ")):
        x, width = at(s, cut)[0], 25.5
        page.stroke((x, field.y), (x, field.bottom + 1.0), 0.1, 0.7, 0 < s < 1)
        page.write((min(x - 0.5 * width, field.right - width), field.bottom + 1.2, width, TEXT),
                   f"{end}s {rounded(s, 2)}: {mm(s * section['length_m'], 0)}", RIGHT if s == 1 else CENTRE)
    centres = [at(tag["s"], tag["angle"]) for tag in tags]
    distances = [max(abs(a[0] - b[0]), abs(a[1] - b[1])) for i, a in enumerate(centres) for b in centres[:i]]
    side = min(9.0, max(2.5, 0.9 * min(distances, default=math.inf)))
    for tag, centre in zip(tags, centres):
        for gray, half in ((0.0, 0.5 * side), (1.0, 0.5 * side - 0.2)):  # white hides the lines behind it
            page.areas.append((gray, turned(centre, tag["turn"], [(-half, -half), (half, -half), (half, half), (-half, half)])))
        page.up_mark(turned(centre, tag["turn"], [(0, 0.36 * side)])[0], 0.16 * side, tag["turn"])
        page.write((centre[0] - 0.3 * side, centre[1] - 0.21 * side, 0.6 * side, 0.42 * side), str(tag["id"]), CENTRE, True)


def board_page(board, paper):
    """A board for the calibration of a camera, at its exact size."""
    size = f"{board['columns']} x {board['rows']}"
    if "dictionary" in board:
        bit = 1e3 * board["bit_m"]
        if bit < LEAST_BIT:
            raise Refused(f"a marker {board['dictionary']} of {mm(board['marker_size_m'])} has bits of {rounded(bit, 2)} mm; "
                          f"expected {LEAST_BIT} mm or more, so that printer and camera resolve them. Choose larger markers "
                          "(--marker-size-m, --square-size-m), or a dictionary with fewer bits")
        title = (f"ChArUco board: {board['dictionary']}, {size} squares of {mm(board['square_size_m'])}, markers of "
                 f"{mm(board['marker_size_m'])}")
        note = "Read it with helix_arm camera calibrate --board charuco and the options it was printed with."
    else:
        title = f"Calibration board: {board['family']}, {size} tags of {mm(board['size_m'])}, every {mm(board['pitch_m'])}"
        note = f"Its tags are {board['first_id']} to {board['first_id'] + board['columns'] * board['rows'] - 1}."
    free = paper.free
    width, height = (1e3 * side for side in board["extent_m"])
    if width > free.width or height > free.height:
        raise Refused(f"a board of {rounded(width, 1)} x {rounded(height, 1)} mm; expected at most {rounded(free.width, 1)} x "
                      f"{rounded(free.height, 1)} mm, the printable area of {paper.name}")
    page = Page(paper, title, [ACTUAL_SIZE + "Glue it onto something flat and stiff:",
                               "a board that bends spoils the calibration. " + note])
    page.rulers(paper, ["Both rulers must be 100 mm long on paper.", "If not, print again without scaling."])
    x, y = free.x + 0.5 * (free.width - width), free.y + 0.5 * (free.height - height)
    for grid in board["grids"]:
        page.cells(grid["cells"], (x + 1e3 * grid["at_m"][0], y + 1e3 * grid["at_m"][1]), 1e3 * grid["cell_m"])
    return page


def lay_out(report):
    """The pages of what helix_arm tags asks for: `arm` (tags and where they are mounted) and `board`, or one of them."""
    paper = Paper(report["paper"])
    pages = card_pages(report["arm"], paper) + Mounting(report["arm"], paper).pages if report["arm"] else []
    if report["board"]:
        pages.append(board_page(report["board"], paper))
    for i, page in enumerate(pages):
        page.write((paper.area.right - 28.0, paper.area.y + 0.6, 28.0, TEXT), f"page {i + 1} of {len(pages)}", RIGHT)
    return pages, paper.size


def draw_page(page, size, drawing):
    """Only lines, areas, and text in embedded fonts."""
    Path, text_to_path = drawing.path.Path, drawing.textpath.text_to_path
    figure = drawing.page(*(side / 25.4 for side in size), dpi=72)
    figure.patch.set_visible(False)
    to_paper = drawing.transforms.Affine2D().scale(POINT, -POINT).translate(0, POINT * size[1])

    def add(paths, **style):
        figure.add_artist(drawing.patches.PathPatch(Path.make_compound_path(*paths), transform=to_paper, snap=False, **style))

    def polygon(corners):
        return Path([*corners, corners[0]], closed=True)

    for (width, gray, dashed), strokes in page.strokes.items():
        add([Path(ends) for ends in strokes], fill=False, edgecolor=str(gray), linewidth=POINT * width, capstyle="butt",
            linestyle=(0, (POINT, POINT)) if dashed else "-", zorder=1)
    for gray, corners in page.areas:
        add([polygon(corners)], facecolor=str(gray), linewidth=0, zorder=2)
    if page.black:  # as one area, since viewers show seams between adjacent ones
        add([polygon(box.corners) for box in page.black], facecolor="black", linewidth=0, zorder=3)
    for box, text, align, bold in page.labels:
        font = drawing.font_manager.FontProperties(weight="bold" if bold else "normal", size=POINT * FONT_SIZE * box.height)
        extent = text_to_path.get_text_width_height_descent(text, font, False)[0] / POINT
        part = min(1.0, box.width / extent) if extent else 1.0
        font.set_size(part * font.get_size())
        # Reduced text is centred vertically in its line.
        baseline = box.y + BASELINE * box.height - (BASELINE - 0.5) * box.height * (1 - part)
        figure.text(box.x + align * (box.width - part * extent), baseline, drawing.plain(text), transform=to_paper,
                    fontproperties=font, zorder=4)
    return figure
