#include <algorithm>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <memory>
#include <sstream>

#include "arguments.hpp"
#include "board_arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/tag_sheets.hpp"
#include "output.hpp"
#include "pdf.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using procedures::kPapers;
using procedures::Page;
using procedures::Paper;

struct TagsArguments {
  std::string scene, out, paper = kPapers[0].name;
  BoardArguments board;
};

/// What was printed.
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

json toJson(const Print& print) {
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

CsvTable toCsv(const Print& print) {
  const bool scene = print.scene.has_value();
  CsvTable table;
  table.add({{"scene", scene ? print.scene->name : ""},
             {"tags", std::to_string(scene ? print.scene->tags->tags.size() : 0)},
             {"size_m", scene ? exact(print.scene->tags->size) : ""},
             {"board", print.board ? "1" : "0"},
             {"paper", print.paper.name},
             {"pages", std::to_string(print.pages)},
             {"out", print.out}});
  return table;
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
  if (global.format == Format::kJson) printJson(toJson(print));
  if (global.format == Format::kCsv) toCsv(print).print(std::cout);
  if (global.format == Format::kText) printText(print);
  return kDone;
}

}  // namespace

Subcommand addTags(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "tags", "print the tags of a scene and where they are mounted, or a calibration board");
  const auto arguments = std::make_shared<TagsArguments>();
  addScene(*command, "SCENE", arguments->scene,
           "needed unless --board is given: scene file with tags");
  command->add_option("--out", arguments->out, "PDF file to write")
      ->required()
      ->type_name("FILE.pdf");
  command->add_option("--paper", arguments->paper, "paper: a4 or letter")
      ->check(CLI::IsMember(paperNames()))
      ->capture_default_str();
  addBoardFlag(*command, arguments->board,
               "also a board for the calibration of a camera: tags (default), whose size does not "
               "depend on --paper, or charuco");
  command->footer(
      "Every tag is drawn at tags.size_m with its id, its place on the arm, a cut line and an up\n"
      "mark. The pages after that show the unrolled arm with s, muscle, angle and stand-off of\n"
      "each tag. Print at 100 % (\"actual size\"): two rulers of 100 mm show whether the printer\n"
      "keeps to it.\n"
      "json: scene, family, size_m (null without SCENE), ids, board {family, first_id, columns,\n"
      "rows, size_m, pitch_m} (null without --board; of a ChArUco board {dictionary, columns,\n"
      "rows, square_size_m, marker_size_m, legacy_pattern}), paper, pages (number), out.\n"
      "csv: a row of scene, tags, size_m, board, paper, pages, out.");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
