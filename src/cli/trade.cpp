#include "trade.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <memory>
#include <sstream>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/report_plot.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kMostPictures = 10000;
// Errors below this fraction of the arm's length are rounding and count as equal. plot_report uses
// the same.
constexpr double kRounding = 1e-13;

struct TradeOptions {
  std::string scene, out;
  int pictures = 60;
  bool no_files = false;
};

struct Trade {
  std::string scene;
  std::vector<TradeRow> rows;
  std::vector<std::string> notes;  // on parts that could not be measured
};

Trade measure(const io::Scene& scene, const TradeOptions& options) {
  Trade trade{scene.name, modelRows(scene), {}};
  if (trade.rows.empty()) {
    trade.notes.push_back(
        "no shape balances the scene's load at any sampled input, so there is nothing to "
        "measure; check load and K_eps_n: less load, or stiffer muscles");
    return trade;
  }
  const auto append = [&trade](std::vector<TradeRow> rows) {
    trade.rows.insert(trade.rows.end(), std::make_move_iterator(rows.begin()),
                      std::make_move_iterator(rows.end()));
  };
  append(drawingRows(scene));
  if (options.pictures == 0) {
    trade.notes.push_back("no pictures were requested: sight and fit are not measured");
  } else if (!scene.camera || !scene.tags) {
    trade.notes.push_back("the scene has no camera or no tags: sight and fit are not measured");
  } else {
    std::vector<TradeRow> vision = visionRows(scene, options.pictures);
    if (vision.empty()) {
      trade.notes.push_back(
          "the scene's tier finds no shape to start from at any picture: sight and fit are not "
          "measured");
    }
    append(std::move(vision));
  }
  markFrontier(trade.rows);
  return trade;
}

json toJson(const Trade& trade) {
  json rows = json::array();
  for (const TradeRow& row : trade.rows) {
    const bool answered = std::isfinite(row.error);
    rows.push_back({{"part", row.part},
                    {"tier", row.tier},
                    {"setting", row.setting},
                    {"time_ns", 1e9 * row.time},
                    {"tip_error_percent", answered ? json(100 * row.error) : json()},
                    {"on_frontier", row.on_frontier}});
  }
  return {{"scene", trade.scene}, {"rows", rows}, {"notes", trade.notes}};
}

CsvTable toCsv(const Trade& trade) {
  CsvTable table;
  for (const TradeRow& row : trade.rows) {
    table.add({{"part", row.part},
               {"tier", row.tier},
               {"setting", row.setting},
               {"time_ns", exact(1e9 * row.time)},
               {"tip_error_percent", std::isfinite(row.error) ? exact(100 * row.error) : ""},
               {"on_frontier", row.on_frontier ? "1" : "0"}});
  }
  return table;
}

std::string timeText(double seconds) {
  const bool long_time = seconds >= 1e-3, short_time = seconds < 1e-6;
  std::ostringstream text;
  text << std::setprecision(3)
       << seconds * (long_time    ? 1e3
                     : short_time ? 1e9
                                  : 1e6)
       << (long_time    ? " ms"
           : short_time ? " ns"
                        : " us");
  return text.str();
}

std::string errorText(double error) {
  if (!std::isfinite(error)) return "no answer";
  if (error < kRounding) return "none";
  std::ostringstream text;
  text << std::setprecision(2) << 100 * error << " %";
  return text.str();
}

void printText(const Trade& trade) {
  std::cout << trade.scene << ": time of one answer and largest error, in % of the arm's length\n"
            << "(* no faster row of the same part is as accurate)\n";
  std::string part;
  for (const TradeRow& row : trade.rows) {
    if (row.part != part) {
      part = row.part;
      std::cout << part << "\n";
    }
    std::cout << (row.on_frontier ? " * " : "   ") << std::left << std::setw(15) << row.tier
              << std::setw(24) << row.setting << std::right << std::setw(11) << timeText(row.time)
              << std::setw(12) << errorText(row.error) << "\n";
  }
  for (const std::string& note : trade.notes) std::cout << note << "\n";
}

fs::path makeFolder(const TradeOptions& options, const std::string& scene) {
  const fs::path folder = options.out.empty() ? "trade_" + scene : options.out;
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error && fs::is_directory(folder, error)) return folder;
  throw CallerError("--out " + folder.string() +
                    " cannot be created: " + (error ? error.message() : "a file is in its place") +
                    "; choose another folder");
}

int run(const TradeOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  std::optional<fs::path> folder;
  if (!options.no_files) folder = makeFolder(options, scene.name);
  const Trade trade = measure(scene, options);
  const json report = toJson(trade);
  if (global.format == Format::kJson) printJson(report);
  if (global.format == Format::kCsv) toCsv(trade).print(std::cout);
  if (global.format == Format::kText) printText(trade);
  if (trade.rows.empty()) return kNotPossible;
  if (!folder) return kDone;
  std::ostringstream csv;
  toCsv(trade).print(csv);
  io::writeFileAtomically(*folder / "trade.csv", csv.str());
  io::writeFileAtomically(*folder / "trade.json", report.dump(2) + "\n");
  procedures::drawReport(*folder / "trade.json", *folder / "trade.png",
                         "leave it out with --no-files");
  std::cerr << "wrote trade.csv, trade.json and trade.png to " << folder->string() << "\n";
  return kDone;
}

}  // namespace

void markFrontier(std::vector<TradeRow>& rows) {
  const auto errorOf = [](const TradeRow& row) { return std::max(row.error, kRounding); };
  for (TradeRow& row : rows) {
    row.on_frontier = std::isfinite(row.error) &&
                      std::none_of(rows.begin(), rows.end(), [&](const TradeRow& other) {
                        if (other.part != row.part) return false;
                        const bool no_worse =
                            other.time <= row.time && errorOf(other) <= errorOf(row);
                        return no_worse && (other.time < row.time || errorOf(other) < errorOf(row));
                      });
  }
}

Subcommand addTrade(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("trade", "measure accuracy against time on this scene and machine");
  const auto options = std::make_shared<TradeOptions>();
  addScene(*command, "SCENE", options->scene, "scene file")->required();
  command->add_option(
      "--out", options->out,
      "folder for trade.csv, trade.json and trade.png, created if absent; default: trade_ and the "
      "scene's name");
  command->add_flag("--no-files", options->no_files, "only print, write no files");
  command
      ->add_option("--pictures", options->pictures,
                   "number of pictures rendered to measure sight and fit; 0 omits both")
      ->check(CLI::Range(0, kMostPictures))
      ->capture_default_str();
  command->footer(
      "Parts: model (largest tip error against the exact tier, over sampled inputs), curve and\n"
      "markers (largest distance between what is drawn and the exact curve), sight and fit\n"
      "(median tip error over rendered pictures, against the true arm of the simulation). Times\n"
      "are medians on this machine.\n"
      "json: rows [{part, tier, setting, time_ns, tip_error_percent (null: no answer),\n"
      "on_frontier}], notes.\n"
      "csv: the rows. Exit code 1, without rows or files, if no shape balances the load at any\n"
      "sampled input.");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
