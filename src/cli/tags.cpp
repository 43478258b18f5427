#include <algorithm>
#include <filesystem>

#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "io/document/number.hpp"
#include "procedures/report_plot.hpp"
#include "procedures/rig_check.hpp"
#include "procedures/unrolled_tags.hpp"
#include "vision/charuco_board.hpp"

namespace helix_arm::cli {

namespace {

const std::vector<std::string> kPapers = {"a4", "letter"};  // tag_pages.py has their sizes

struct TagsArguments {
  std::string scene, out, paper = kPapers[0];
  bool all_tags = false;
  BoardArguments board;
};

// The print.
struct Print {
  std::optional<io::Scene> scene;  // with the tags to print
  std::vector<int> left_out;       // ids of its other tags
  std::optional<CalibrationBoard> board;
};

// Leaves out the tags that no shape shows to the camera, unless that is all of them.
void leaveOutUnseen(Print& print) {
  const auto sight = procedures::checkRig(*print.scene).vision;
  if (!sight || sight->unseen.size() == print.scene->tags->tags.size()) return;
  print.left_out = sight->unseen;
  auto& tags = print.scene->tags->tags;
  const auto is_unseen = [&](const estimation::TagPlacement& tag) {
    return std::count(print.left_out.begin(), print.left_out.end(), tag.id) > 0;
  };
  tags.erase(std::remove_if(tags.begin(), tags.end(), is_unseen), tags.end());
}

// A line per row of cells, with # for black ones.
json rowsOf(const cv::Mat& cells) {
  json rows;
  for (int row = 0; row < cells.rows; ++row) {
    std::string text;
    for (int column = 0; column < cells.cols; ++column) {
      text += cells.at<unsigned char>(row, column) == 0 ? '#' : ' ';
    }
    rows.push_back(text);
  }
  return rows;
}

// The tags and where they are mounted, as tag_pages.py lays them out.
json armJson(const io::Scene& scene) {
  basics::require(scene.tags && !scene.tags->tags.empty() && !scene.hasBodies(), "scene ",
                  scene.name, " has no tags; expected a scene with a section tags");
  const vision::TagFamily family(scene.vision.detector.family);
  json sections, tags;
  for (int i = 0; i < scene.arm.sectionCount(); ++i) {
    sections.push_back({{"name", scene.looks[static_cast<std::size_t>(i)].name},
                        {"length_m", scene.arm.restLength(i)}});
    for (int k = scene.arm.firstActuator(i); k < scene.arm.firstActuator(i + 1); ++k) {
      const model::Actuator& actuator = scene.arm.actuator(k);
      sections.back()["muscles"].push_back(
          {{"name", actuator.name}, {"angle", procedures::angleAround(actuator)}});
    }
  }
  for (const procedures::UnrolledTag& tag : procedures::unrolled(scene.arm, *scene.tags)) {
    tags.push_back({{"id", tag.id},
                    {"section", tag.section},
                    {"muscle", scene.arm.actuator(tag.actuator).name},
                    {"s", tag.s},
                    {"from_base_m", tag.from_base},
                    {"angle", tag.angle},
                    {"radius_m", tag.radius},
                    {"standoff_m", tag.standoff},
                    {"aside_m", tag.aside},
                    {"turn", tag.turn},
                    {"tilt", tag.tilt},
                    {"cells", rowsOf(family.cells(tag.id))}});
  }
  return {{"scene", scene.name},
          {"family", family.name()},
          {"size_m", scene.tags->size},
          {"border_cells", family.borderCells()},
          {"size_edge", family.sizeEdge()},
          {"sections", sections},
          {"tags", tags}};
}

json gridJson(double x, double y, double cell, const json& cells) {
  return {{"at_m", {x, y}}, {"cell_m", cell}, {"cells", cells}};
}

// A board with its extent and grids of black cells, from its top left corner.
json printedJson(const vision::TagBoard& board) {
  const vision::TagFamily family(board.family);
  const double cell = board.tag_size / family.borderCells();
  const double border = 2 * family.quietCells() * cell;
  json out = boardJson(board);
  out["extent_m"] = {board.width() + border, board.height() + border};
  for (int i = 0; i < board.count(); ++i) {
    out["grids"].push_back(gridJson(i % board.columns * board.pitch,
                                    i / board.columns * board.pitch, cell,
                                    rowsOf(family.cells(board.first_id + i))));
  }
  return out;
}

json printedJson(const vision::CharucoBoard& board) {
  const double side = board.square_size, inset = 0.5 * (side - board.marker_size);
  json out = boardJson(board);
  out["bit_m"] = board.bitSize();
  out["extent_m"] = {board.width(), board.height()};
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const double x = column * side, y = row * side;
      if (!board.isWhite(column, row)) {
        out["grids"].push_back(gridJson(x, y, side, json::array({"#"})));
        continue;
      }
      const cv::Mat cells = vision::markerCells(board.dictionary, board.markerIn(column, row));
      out["grids"].push_back(
          gridJson(x + inset, y + inset, board.marker_size / cells.cols, rowsOf(cells)));
    }
  }
  return out;
}

// Prints it. @return the number of pages.
json writePages(const Print& print, const TagsArguments& arguments) {
  json pages{{"title", print.scene ? "Tags of " + print.scene->name : "Calibration board"},
             {"paper", arguments.paper},
             {"arm", print.scene ? armJson(*print.scene) : json()},
             {"board", nullptr}};
  if (print.board) {
    pages["board"] = std::visit([](const auto& board) { return printedJson(board); }, *print.board);
  }
  const std::string printed =
      procedures::drawReport(json{{"pages", pages}}.dump(), arguments.out, "choose another path");
  return json::parse(printed).at("pages");
}

json reportOf(const Print& print, const TagsArguments& arguments, const json& pages) {
  json result{
      {"left_out", print.left_out}, {"board", print.board ? boardJson(*print.board) : json()},
      {"paper", arguments.paper},   {"pages", pages},
      {"ids", json::array()},       {"out", arguments.out}};
  for (const char* key : {"scene", "family", "size_m"}) result[key] = nullptr;
  if (!print.scene) return result;
  result["scene"] = print.scene->name;
  result["family"] = print.scene->vision.detector.family;
  result["size_m"] = print.scene->tags->size;
  for (const auto& tag : print.scene->tags->tags) result["ids"].push_back(tag.id);
  return result;
}

void check(const TagsArguments& arguments, const GlobalOptions& global) {
  checkBoard(arguments.board);
  refuseIf(arguments.scene.empty() && !arguments.board.given(),
           "nothing to print: give a SCENE with tags, --board or both");
  refuseIf(arguments.scene.empty() && !global.overrides.empty(),
           "--set changes a key of SCENE, which is not given; leave out --set");
  refuseIf(std::filesystem::path(arguments.out).extension() != ".pdf", "--out ", arguments.out,
           " does not end in .pdf; name a .pdf file");
}

int run(const TagsArguments& arguments, const GlobalOptions& global) {
  check(arguments, global);
  Print print;
  if (!arguments.scene.empty()) print.scene = loadScene(arguments.scene, global);
  if (print.scene && !arguments.all_tags) leaveOutUnseen(print);
  if (arguments.board.given()) print.board = boardOf(arguments.board);
  requireWritable({arguments.out});
  const json report = reportOf(print, arguments, writePages(print, arguments));
  json counts = report;
  counts["tags"] = report["ids"].size();
  counts["board"] = print.board.has_value();
  json shown = without(counts, {"ids", "left_out"});
  shown["board"] = textOrNull(arguments.board.kind);
  shown["notes"] = {"print at 100 % (\"actual size\"); both rulers must then be 100 mm long"};
  if (print.scene) {
    shown["notes"].push_back("each tag then measures " +
                             basics::format("%g mm over the ", 1e3 * print.scene->tags->size) +
                             vision::TagFamily(print.scene->vision.detector.family).sizeEdge());
  }
  if (!print.left_out.empty()) {
    shown["notes"].push_back("left out, since no shape shows them to the camera: tags " +
                             io::listOf(print.left_out) + "; --all-tags prints them as well");
  }
  const Csv csv{{"scene", "tags", "size_m", "board", "paper", "pages", "out"}};
  printResult(global.format, report, shown, [&](std::ostream& out) { printCsv(counts, csv, out); });
  return kDone;
}

}  // namespace

void addTags(Commands& commands) {
  auto [command, arguments] = commands.add<TagsArguments>(
      "tags", "print the tags of a scene and where they are mounted, or a calibration board", run);
  addSceneOption(command, "SCENE", arguments.scene,
                 "needed unless --board is given: scene file with tags");
  addOption(command, "--out", arguments.out, "PDF file to write", kRequired, TypeName{"FILE.pdf"});
  addOption(command, "--paper", arguments.paper, "paper: a4 or letter", CLI::IsMember(kPapers),
            kShowDefault);
  command.add_flag("--all-tags", arguments.all_tags,
                   "also the tags that no shape shows to the scene's camera");
  addBoardFlag(command, arguments.board,
               "also a board for the calibration of a camera: tags (default), whose size does not "
               "depend on --paper, or charuco");
  command.footer(
      R"(Every tag is drawn at tags.size_m with its id, its place on the arm, a cut line and an up
mark. The pages after that show the unrolled arm with s, muscle, angle and stand-off of
each tag. Print at 100 % ("actual size"): two rulers of 100 mm show whether the printer
keeps to it.
json: scene, family, size_m (null without SCENE), ids, left_out (ids), board {family,
first_id, columns, rows, size_m, pitch_m} (null without --board; of a ChArUco board
{dictionary, columns, rows, square_size_m, marker_size_m, legacy_pattern}), paper, pages
(number), out.
csv: a row of scene, tags, size_m, board, paper, pages, out.)");
}

}  // namespace helix_arm::cli
