#include <algorithm>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/procedures/report_plot.hpp"
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

// What plot_report prints of a page, in mm from its top left corner.
nlohmann::json toJson(const Page& page) {
  nlohmann::json strokes, areas, black, labels;
  for (const Stroke& stroke : page.strokes) {
    strokes.push_back({stroke.from.x, stroke.from.y, stroke.to.x, stroke.to.y, stroke.width,
                       stroke.gray, stroke.dashed ? 1 : 0});
  }
  for (const Area& area : page.areas) {
    areas.push_back({{"gray", area.gray}});
    for (const procedures::Point& corner : area.corners) {
      areas.back()["corners"].push_back({corner.x, corner.y});
    }
  }
  for (const PrintedTag& tag : page.tags) {
    for (const Box& box : tag.black) black.push_back({box.x, box.y, box.width, box.height});
  }
  for (const Label& label : page.labels) {
    const Box& box = label.box;
    const double align = label.align == Align::kLeft ? 0 : label.align == Align::kCentre ? 0.5 : 1;
    labels.push_back({{"text", label.text},
                      {"box", {box.x, box.y, box.width, box.height}},
                      {"align", align},
                      {"bold", label.bold}});
  }
  return {{"strokes", strokes}, {"areas", areas}, {"black", black}, {"labels", labels}};
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
  checkPicture(print.out, "");
  const std::vector<Page> pages = pagesOf(print);
  print.pages = pages.size();
  json drawn{{"title", print.scene ? "Tags of " + print.scene->name : "Calibration board"},
             {"size_mm", {print.paper.width, print.paper.height}}};
  for (const Page& page : pages) drawn["pages"].push_back(toJson(page));
  procedures::drawReportText(drawn.dump(), print.out, "choose another path");
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
