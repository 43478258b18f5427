#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <cairo/cairo-pdf.h>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/tag_sheets.hpp"
#include "output.hpp"

namespace helix_arm::cli {

namespace {

using procedures::Align;
using procedures::Area;
using procedures::Box;
using procedures::Label;
using procedures::Page;
using procedures::PrintedTag;
using procedures::Stroke;

constexpr double kPointsPerMillimetre = 72 / 25.4;
constexpr double kDash = 1.0;  // [mm]

using Surface = std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)>;
using Context = std::unique_ptr<cairo_t, void (*)(cairo_t*)>;

cairo_status_t append(void* bytes, const unsigned char* data, unsigned int size) {
  static_cast<std::string*>(bytes)->append(reinterpret_cast<const char*>(data), size);
  return CAIRO_STATUS_SUCCESS;
}

void check(cairo_status_t status) {
  if (status == CAIRO_STATUS_SUCCESS) return;
  throw std::runtime_error(std::string("the PDF cannot be created: ") +
                           cairo_status_to_string(status));
}

void draw(const PrintedTag& tag, cairo_t* to) {
  // Drawn as one area, since viewers show seams between adjacent ones.
  for (const Box& box : tag.black) cairo_rectangle(to, box.x, box.y, box.width, box.height);
  cairo_fill(to);
}

void draw(const Stroke& stroke, cairo_t* to) {
  cairo_set_source_rgb(to, stroke.gray, stroke.gray, stroke.gray);
  cairo_set_line_width(to, stroke.width);
  cairo_set_dash(to, &kDash, stroke.dashed ? 1 : 0, 0);
  cairo_move_to(to, stroke.from.x, stroke.from.y);
  cairo_line_to(to, stroke.to.x, stroke.to.y);
  cairo_stroke(to);
}

void draw(const Area& area, cairo_t* to) {
  cairo_set_source_rgb(to, area.gray, area.gray, area.gray);
  for (const procedures::Point& corner : area.corners) cairo_line_to(to, corner.x, corner.y);
  cairo_close_path(to);
  cairo_fill(to);
}

void draw(const Label& label, cairo_t* to) {
  // Font size and baseline, as fractions of the line height.
  constexpr double kFontSize = 0.84, kBaseline = 0.79;
  const Box& box = label.box;
  cairo_select_font_face(to, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         label.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_text_extents_t extents;
  double size = kFontSize * box.height;
  cairo_set_font_size(to, size);
  cairo_text_extents(to, label.text.c_str(), &extents);
  if (extents.x_advance > box.width) {
    size *= box.width / extents.x_advance;
    cairo_set_font_size(to, size);
    cairo_text_extents(to, label.text.c_str(), &extents);
  }
  const double spare = box.width - extents.x_advance;
  const double shift = label.align == Align::kLeft     ? 0
                       : label.align == Align::kCentre ? 0.5 * spare
                                                       : spare;
  // Reduced text is centred vertically in its line.
  const double lift = (kBaseline / kFontSize - 0.5 / kFontSize) * (kFontSize * box.height - size);
  cairo_move_to(to, box.x + shift, box.y + kBaseline * box.height - lift);
  cairo_show_text(to, label.text.c_str());
}

void draw(const Page& page, cairo_t* to) {
  for (const Stroke& stroke : page.strokes) draw(stroke, to);
  for (const Area& area : page.areas) draw(area, to);
  cairo_set_source_rgb(to, 0, 0, 0);
  for (const PrintedTag& tag : page.tags) draw(tag, to);
  for (const Label& label : page.labels) draw(label, to);
  cairo_show_page(to);
}

// The bytes of a PDF with these pages. Everything in it is drawn by lines and areas, exact to 2 um,
// and its fonts are embedded. @throws std::runtime_error if the PDF library fails.
std::string pdfOf(const std::vector<Page>& pages, const procedures::Paper& paper,
                  const std::string& title) {
  std::string bytes;
  const Surface surface(
      cairo_pdf_surface_create_for_stream(append, &bytes, kPointsPerMillimetre * paper.width,
                                          kPointsPerMillimetre * paper.height),
      cairo_surface_destroy);
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, title.c_str());
  const Context to(cairo_create(surface.get()), cairo_destroy);
  cairo_scale(to.get(), kPointsPerMillimetre, kPointsPerMillimetre);
  // Text metrics of paper, not of a screen.
  const std::unique_ptr<cairo_font_options_t, void (*)(cairo_font_options_t*)> options(
      cairo_font_options_create(), cairo_font_options_destroy);
  cairo_font_options_set_hint_style(options.get(), CAIRO_HINT_STYLE_NONE);
  cairo_font_options_set_hint_metrics(options.get(), CAIRO_HINT_METRICS_OFF);
  cairo_set_font_options(to.get(), options.get());
  for (const Page& page : pages) draw(page, to.get());
  check(cairo_status(to.get()));
  cairo_surface_finish(surface.get());
  check(cairo_surface_status(surface.get()));
  return bytes;
}

using nlohmann::json;
using procedures::kPapers;
using procedures::Paper;

struct TagsArguments {
  std::string scene, out, paper = kPapers[0].name;
  BoardArguments board;
};

// What was printed.
struct Print {
  std::optional<io::Scene> scene;
  std::optional<CalibrationBoard> board;
  Paper paper;
  std::size_t pages;
  std::string out;
};

std::vector<std::string> paperNames() {
  std::vector<std::string> names;
  names.reserve(kPapers.size());
  for (const Paper& paper : kPapers) names.emplace_back(paper.name);
  return names;
}

Paper paperNamed(const std::string& name) {
  return *std::find_if(kPapers.begin(), kPapers.end(),
                       [&name](const Paper& paper) { return name == paper.name; });
}

std::vector<Page> pagesOf(const Print& print) {
  std::vector<Page> pages;
  if (print.scene) {
    pages = procedures::tagSheets(*print.scene, print.paper);
    for (const Page& page : procedures::placementSheets(*print.scene, print.paper)) {
      pages.push_back(page);
    }
  }
  if (print.board) {
    pages.push_back(std::visit(
        [&print](const auto& board) { return procedures::boardSheet(board, print.paper); },
        *print.board));
  }
  procedures::numberPages(print.paper, pages);
  return pages;
}

json reportOf(const Print& print) {
  json result{{"scene", nullptr},
              {"family", nullptr},
              {"size_m", nullptr},
              {"ids", json::array()},
              {"board", print.board ? boardJson(*print.board) : json()},
              {"paper", print.paper.name},
              {"pages", print.pages},
              {"out", print.out}};
  if (print.scene) {
    result["scene"] = print.scene->name;
    result["family"] = print.scene->vision.detector.family;
    result["size_m"] = print.scene->tags->size;
    for (const estimation::TagPlacement& tag : print.scene->tags->tags) {
      result["ids"].push_back(tag.id);
    }
  }
  return result;
}

CsvTable toCsv(const Print& print, const json& report) {
  CsvTable::Row row = cellsOf(report, {"scene", "size_m", "paper", "pages", "out"});
  row.insert(row.begin() + 1, {"tags", std::to_string(report["ids"].size())});
  row.insert(row.begin() + 3, {"board", print.board ? "1" : "0"});
  return row;
}

void printText(const Print& print) {
  const char* separator = "";
  if (print.scene) {
    std::cout << print.scene->tags->tags.size() << " tags " << print.scene->vision.detector.family
              << " of " << 1e3 * print.scene->tags->size << " mm and where they are mounted";
    separator = ", ";
  }
  if (print.board) {
    const bool charuco = std::holds_alternative<vision::CharucoBoard>(*print.board);
    std::cout << separator << (charuco ? "a ChArUco board" : "a calibration board");
  }
  std::cout << ": " << print.pages << (print.pages == 1 ? " page " : " pages ") << print.paper.name
            << " in " << print.out << "\n"
            << "Print at 100 % (\"actual size\"); both rulers must then be 100 mm long.\n";
}

void check(const TagsArguments& arguments, const GlobalOptions& global) {
  checkBoard(arguments.board);
  if (arguments.scene.empty() && !arguments.board.given()) {
    throw CallerError("nothing to print: give a SCENE with tags, --board or both");
  }
  if (arguments.scene.empty() && !global.overrides.empty()) {
    throw CallerError("--set changes a key of SCENE, which is not given; leave out --set");
  }
  if (std::filesystem::path(arguments.out).extension() != ".pdf") {
    throw CallerError("--out " + arguments.out + " does not end in .pdf; name a .pdf file");
  }
}

int run(const TagsArguments& arguments, const GlobalOptions& global) {
  check(arguments, global);
  Print print{{}, {}, paperNamed(arguments.paper), 0, arguments.out};
  if (!arguments.scene.empty()) print.scene = loadScene(arguments.scene, global);
  if (arguments.board.given()) print.board = boardOf(arguments.board);
  const std::vector<Page> pages = pagesOf(print);
  print.pages = pages.size();
  io::writeFileAtomically(
      print.out, pdfOf(pages, print.paper,
                       print.scene ? "Tags of " + print.scene->name : "Calibration board"));
  const json report = reportOf(print);
  printResult(
      global.format, report, [&] { return toCsv(print, report); }, [&] { printText(print); });
  return kDone;
}

}  // namespace

Subcommand addTags(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "tags", "print the tags of a scene and where they are mounted, or a calibration board");
  const auto arguments = std::make_shared<TagsArguments>();
  addScene(*command, "SCENE", arguments->scene,
           "needed unless --board is given: scene file with tags");
  addOption(*command, "--out", arguments->out, "PDF file to write", kRequired,
            TypeName{"FILE.pdf"});
  addOption(*command, "--paper", arguments->paper, "paper: a4 or letter",
            CLI::IsMember(paperNames()), kShowDefault);
  addBoardFlag(*command, arguments->board,
               "also a board for the calibration of a camera: tags (default), whose size does not "
               "depend on --paper, or charuco");
  command->footer(
      R"(Every tag is drawn at tags.size_m with its id, its place on the arm, a cut line and an up
mark. The pages after that show the unrolled arm with s, muscle, angle and stand-off of
each tag. Print at 100 % ("actual size"): two rulers of 100 mm show whether the printer
keeps to it.
json: scene, family, size_m (null without SCENE), ids, board {family, first_id, columns,
rows, size_m, pitch_m} (null without --board; of a ChArUco board {dictionary, columns,
rows, square_size_m, marker_size_m, legacy_pattern}), paper, pages (number), out.
csv: a row of scene, tags, size_m, board, paper, pages, out.)");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
