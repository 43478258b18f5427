#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <exception>
#include <filesystem>
#include <fstream>
#include <future>
#include <iomanip>
#include <iostream>
#include <memory>
#include <sstream>
#include <thread>

#include <stdlib.h>
#include <unistd.h>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/median.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/statics/workspace_extremes.hpp"
#include "interrupt_watch.hpp"
#include "output.hpp"
#include "plot.hpp"
#include "workspace_file.hpp"
#include "workspace_maps.hpp"
#include "workspace_progress.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kInterrupted = 130;  // as a shell says of Ctrl-C
constexpr std::uint64_t kUsualCount = 10000000;
constexpr std::uint64_t kUsualSensitiveCount = 200000;
constexpr std::uint64_t kMostCount = 10000000000;
constexpr int kMostThreads = 256;
// Points that medians and maps are made of: they are drawn evenly, so that the first are as good as
// all.
constexpr std::size_t kMostKept = 2000000;

struct WorkspaceArguments {
  std::string scene, out, png;
  std::optional<std::uint64_t> count;
  std::uint64_t seed = 1;
  bool sensitivity = false;
  int threads = 0;  // 0: all cores
  TierArguments tier;

  std::uint64_t inputs() const {
    return count.value_or(sensitivity ? kUsualSensitiveCount : kUsualCount);
  }
};

struct Summary {
  std::uint64_t inputs = 0, unbalanced = 0;
  double seconds = 0.0;
  statics::WorkspaceExtremes sampled;   // of the points
  statics::WorkspaceExtremes extremes;  // that a search found from there
  Eigen::Vector3d worst = Eigen::Vector3d::Zero();
  std::vector<CloudPoint> kept;
  bool whole = false;  // not interrupted

  std::uint64_t points() const { return inputs - unbalanced; }
  double median(int k) const {
    std::vector<double> values;
    for (const CloudPoint& point : kept) values.push_back(point.sensitivity[k]);
    return basics::medianOf(std::move(values));
  }
};

void add(const statics::WorkspacePoints& points, bool keep, Summary& summary) {
  summary.inputs += static_cast<std::uint64_t>(points.count() + points.unbalanced);
  summary.unbalanced += static_cast<std::uint64_t>(points.unbalanced);
  if (points.count() == 0) return;
  summary.sampled.add(points);
  const bool sensitive = points.sensitivity.rows() > 0;
  if (sensitive) {
    summary.worst =
        summary.worst.cwiseMax(points.sensitivity.colwise().maxCoeff().transpose()).eval();
  }
  for (int row = 0; keep && row < points.count() && summary.kept.size() < kMostKept; ++row) {
    CloudPoint point{points.tips.row(row), Eigen::Vector3d::Zero()};
    if (sensitive) point.sensitivity = points.sensitivity.row(row);
    summary.kept.push_back(point);
  }
}

// Samples on all threads and takes the pieces in their order, so that the result does not tell how
// many threads there were. Ends early when interrupted.
Summary sample(const statics::Workspace& workspace, const WorkspaceArguments& arguments,
               CloudFile* file) {
  struct Piece {
    statics::WorkspacePoints points;
    std::string encoded;
  };
  const std::uint64_t total = arguments.inputs();
  const int size = workspace.pieceSize();  // few enough to end soon after Ctrl-C
  const auto make = [&workspace, file, total, size](std::uint64_t first) {
    const auto count = static_cast<int>(std::min<std::uint64_t>(total - first, size));
    Piece piece{workspace.sample(first, count), {}};
    if (file != nullptr) piece.encoded = file->encode(piece.points);
    return piece;
  };
  const std::size_t threads = arguments.threads > 0
                                  ? static_cast<std::size_t>(arguments.threads)
                                  : std::max(1u, std::thread::hardware_concurrency());
  Summary summary;
  Progress progress(total);
  std::deque<std::future<Piece>> pieces;
  std::uint64_t begun = 0;
  while (!interrupted() && summary.inputs < total) {
    while (begun < total && pieces.size() < threads) {
      pieces.push_back(std::async(std::launch::async, make, begun));
      begun += static_cast<std::uint64_t>(size);
    }
    const Piece piece = pieces.front().get();
    pieces.pop_front();
    if (file != nullptr) {
      file->write(piece.encoded, static_cast<std::uint64_t>(piece.points.count()));
    }
    add(piece.points, arguments.sensitivity || !arguments.png.empty(), summary);
    progress.reached(summary.inputs);
  }
  summary.whole = !interrupted();
  if (file != nullptr && summary.whole && summary.points() > 0) file->finish();
  summary.seconds = progress.seconds();
  return summary;
}

// A file for plot_report, which goes away with the object.
class ReportFile {
 public:
  explicit ReportFile(const json& report)
      : path_((fs::temp_directory_path() / "helix_arm_workspace_XXXXXX").string()) {
    const int file = mkstemp(path_.data());
    if (file < 0) throw CallerError(path_ + " cannot be made; set TMPDIR to a folder with room");
    close(file);
    std::ofstream stream(path_);
    stream << report;
    if (!stream.flush()) {
      fs::remove(path_);
      throw CallerError(path_ + " cannot be written; set TMPDIR to a folder with room");
    }
  }
  ~ReportFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  ReportFile(const ReportFile&) = delete;
  ReportFile& operator=(const ReportFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// Whether both name one file, there or not.
bool samePlace(const std::string& one, const std::string& other) {
  std::error_code error;
  if (fs::equivalent(one, other, error)) return true;
  return fs::weakly_canonical(fs::absolute(one)) == fs::weakly_canonical(fs::absolute(other));
}

// Before the points are sampled, which may take long.
void checkPng(const WorkspaceArguments& arguments) {
  if (arguments.png.empty()) return;
  if (!arguments.out.empty() && samePlace(arguments.out, arguments.png)) {
    throw CallerError("--png " + arguments.png + " is the file of --out; name another one");
  }
  const io::AtomicFile trial(arguments.png);  // throws where none can be written; leaves nothing
}

void drawMaps(const WorkspaceArguments& arguments, const std::string& scene,
              const std::string& tier, const Summary& summary) {
  const json maps = mapsJson(summary.kept, arguments.sensitivity);
  if (maps.empty()) {
    throw CallerError("--png " + arguments.png + " has nothing to draw: the " +
                      std::to_string(summary.points()) +
                      (summary.points() == 1 ? " tip is" : " tips keep to") +
                      " a line or a point; sample more with --count, or leave out --png");
  }
  const ReportFile report({{"scene", scene},
                           {"tier", tier},
                           {"points", summary.kept.size()},
                           {"reach_m", summary.extremes.reach()},
                           {"maps", maps}});
  drawReport(report.path(), arguments.png, "leave out --png");
}

std::string failureOf(const Summary& summary) {
  return summary.points() > 0 ? "" : "at no sampled input a shape balances the load";
}

json toJson(const io::Scene& scene, const statics::TierSetting& setting,
            const WorkspaceArguments& arguments, const Summary& summary) {
  const bool some = summary.points() > 0;
  json sensitivity;
  for (int k = 0; k < statics::kSensitivities && some && arguments.sensitivity; ++k) {
    sensitivity[statics::kSensitivityNames[k]] = {{"median", summary.median(k)},
                                                  {"max", summary.worst[k]}};
  }
  const auto bounds = [](const statics::WorkspaceExtremes& extremes) {
    const auto corner = [](const Eigen::Vector3d& p) { return cli::toJson(Eigen::VectorXd(p)); };
    return json{{"min", corner(extremes.bounds().min())}, {"max", corner(extremes.bounds().max())}};
  };
  const std::string failure = failureOf(summary);
  return {{"scene", scene.name},
          {"tier", statics::nameOf(setting.tier)},
          {"order", setting.order > 0 ? json(setting.order) : json()},
          {"seed", arguments.seed},
          {"count", summary.inputs},
          {"unbalanced", summary.unbalanced},
          {"failure", failure.empty() ? json() : json(failure)},
          {"seconds", summary.seconds},
          {"points_per_second", static_cast<double>(summary.inputs) / summary.seconds},
          {"bounds_m", some ? bounds(summary.extremes) : json()},
          {"reach_m", some ? json(summary.extremes.reach()) : json()},
          {"sampled_bounds_m", some ? bounds(summary.sampled) : json()},
          {"sampled_reach_m", some ? json(summary.sampled.reach()) : json()},
          {"out", some && !arguments.out.empty() ? json(arguments.out) : json()},
          {"png", some && !arguments.png.empty() ? json(arguments.png) : json()},
          {"sensitivity", sensitivity}};
}

CsvTable toCsv(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const Summary& summary) {
  const bool some = summary.points() > 0;
  CsvTable::Row row{{"scene", scene.name},
                    {"tier", statics::nameOf(setting.tier)},
                    {"order", orderCell(setting)},
                    {"seed", std::to_string(arguments.seed)},
                    {"count", std::to_string(summary.inputs)},
                    {"unbalanced", std::to_string(summary.unbalanced)},
                    {"seconds", exact(summary.seconds)}};
  const auto addExtremes = [some, &row](const std::string& prefix,
                                        const statics::WorkspaceExtremes& extremes) {
    const char* const axes[] = {"x_m", "y_m", "z_m"};
    const Eigen::AlignedBox3d bounds = extremes.bounds();
    for (int i = 0; i < 3; ++i) {
      const std::string name = axes[i];
      row.emplace_back(prefix + "min_" + name, some ? exact(bounds.min()[i]) : "");
      row.emplace_back(prefix + "max_" + name, some ? exact(bounds.max()[i]) : "");
    }
    row.emplace_back(prefix + "reach_m", some ? exact(extremes.reach()) : "");
  };
  addExtremes("", summary.extremes);
  for (int k = 0; k < statics::kSensitivities && some && arguments.sensitivity; ++k) {
    const std::string name = statics::kSensitivityNames[k];
    row.emplace_back("median_" + name, exact(summary.median(k)));
    row.emplace_back("max_" + name, exact(summary.worst[k]));
  }
  addExtremes("sampled_", summary.sampled);
  CsvTable table;
  table.add(row);
  return table;
}

void printText(const io::Scene& scene, const statics::TierSetting& setting,
               const WorkspaceArguments& arguments, const Summary& summary) {
  std::cout << scene.name << ", tier " << setting.name() << ": " << summary.inputs << " inputs in "
            << std::setprecision(3) << summary.seconds << " s, "
            << rateText(static_cast<double>(summary.inputs) / summary.seconds) << "\n";
  if (summary.unbalanced > 0) {
    std::cout << "left out, as no shape balances the load: " << summary.unbalanced << "\n";
  }
  if (summary.points() == 0) {
    std::cout << failureOf(summary) << "\n";
    return;
  }
  const Eigen::AlignedBox3d bounds = summary.extremes.bounds();
  std::cout << "tips, seen from the arm's base: from " << bracketed(bounds.min()) << " to "
            << bracketed(bounds.max()) << " m\nreach " << std::fixed << std::setprecision(6)
            << summary.extremes.reach() << " m, searched from the samples and the limits' corners; "
            << "of the samples alone " << summary.sampled.reach() << " m\n";
  const char* const errors[] = {"1 kPa in every pressure", "1 mm in every free length",
                                "1 % in the stiffness"};
  for (int k = 0; k < statics::kSensitivities && arguments.sensitivity; ++k) {
    std::cout << "the tip moves for " << errors[k] << ": median " << std::setprecision(3)
              << 1e3 * summary.median(k) << " mm, largest " << 1e3 * summary.worst[k] << " mm\n";
  }
  for (const std::string& file : {arguments.out, arguments.png}) {
    if (!file.empty()) std::cout << "wrote " << file << "\n";
  }
}

// What is wrong with a --count; empty where nothing is.
std::string checkCount(const std::string& text) {
  const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  const std::optional<double> number = digits ? io::parseNumber(text) : std::nullopt;
  if (number && *number >= 1 && *number <= static_cast<double>(kMostCount)) return {};
  return text + " is not a whole number from 1 to " + std::to_string(kMostCount) +
         ", in digits as 1000000";
}

statics::Workspace workspaceOf(const io::Scene& scene, const WorkspaceArguments& arguments) {
  if (arguments.sensitivity && hasTendon(scene.arm)) {
    throw CallerError("--sensitivity is per kPa, and scene " + scene.name +
                      " has tendons; leave out --sensitivity");
  }
  return statics::Workspace(modelOf(scene, arguments.tier),
                            {arguments.seed, arguments.sensitivity});
}

int run(WorkspaceArguments arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  const statics::Workspace workspace = workspaceOf(scene, arguments);
  const statics::TierSetting& setting = workspace.model().choice().setting;
  checkPng(arguments);
  Summary summary;
  {
    const InterruptWatch watch;
    std::optional<CloudFile> file;
    if (!arguments.out.empty()) {
      file.emplace(arguments.out, scene.arm,
                   CloudOrigin{scene.name, setting.name(), arguments.seed, arguments.sensitivity});
    }
    summary = sample(workspace, arguments, file ? &*file : nullptr);
  }
  if (summary.whole && summary.points() > 0) {
    summary.extremes = statics::findExtremes(workspace.model(), summary.sampled);
  }
  if (!summary.whole) {
    std::cerr << "interrupted after " << summary.inputs << " of " << arguments.inputs()
              << " inputs; nothing was written\n";
    return kInterrupted;
  }
  // The summary comes all the same where the picture fails, and does not name it.
  std::exception_ptr fault;
  try {
    if (!arguments.png.empty() && summary.points() > 0) {
      drawMaps(arguments, scene.name, setting.name(), summary);
    }
  } catch (const CallerError&) {
    fault = std::current_exception();
    arguments.png.clear();
  }
  if (global.format == Format::kJson) printJson(toJson(scene, setting, arguments, summary));
  if (global.format == Format::kCsv) toCsv(scene, setting, arguments, summary).print(std::cout);
  if (global.format == Format::kText) printText(scene, setting, arguments, summary);
  if (fault) std::rethrow_exception(fault);
  return summary.points() > 0 ? kDone : kNotPossible;
}

}  // namespace

Subcommand addWorkspace(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("workspace", "where the tip can go, and how far errors move it there");
  const auto arguments = std::make_shared<WorkspaceArguments>();
  command->add_option("SCENE", arguments->scene, "scene file")->required();
  command->add_option("--out", arguments->out,
                      "file for the points: .ply (binary, float32) or .csv (inputs as well); "
                      "without it only the summary is given");
  command->add_option("--png", arguments->png, "picture of maps of the points");
  command
      ->add_option("--count", arguments->count,
                   "inputs to sample, evenly within their limits; default 10000000, or 200000 with "
                   "--sensitivity")
      ->check(checkCount);
  command->add_flag("--sensitivity", arguments->sensitivity,
                    "also how far the tip moves, at every point");
  command->add_option("--seed", arguments->seed, "of the inputs")->capture_default_str();
  command
      ->add_option("--threads", arguments->threads,
                   "that sample; 0: as many as there are cores. The points are the same")
      ->check(CLI::Range(0, kMostThreads))
      ->capture_default_str();
  addTierOptions(*command, arguments->tier);
  command->footer(
      "Bounds and reach are the largest that a search finds which climbs from the sampled points "
      "and "
      "from corners of the\n"
      "limits (1024, under load 128, exact tier 8) to local maxima: each is a tip of the arm, and "
      "none beyond it is known.\n"
      "sampled_*: of the sampled points alone.\n"
      "Sensitivity: how far the tip moves [m] for an error of 1 kPa in every pressure (per_kpa_m), "
      "of 1 mm in every free\n"
      "length (per_mm_m), of 1 % in every entry of the stiffness, under load also K_eps "
      "(per_percent_K_m); the errors are\n"
      "independent: roots of sums of squares. For arms without tendons.\n"
      "json: scene, tier, order, seed, count (inputs), unbalanced (of them, left out: no shape "
      "balances the load there or,\n"
      "with --sensitivity, with 1 % more stiffness), failure (null where there are points), "
      "seconds, "
      "points_per_second,\n"
      "bounds_m {min, max}, reach_m (largest distance from the base), sampled_bounds_m, "
      "sampled_reach_m, out, png, sensitivity\n"
      "(null, or for each {median,\n"
      "max}; medians, and maps, of the first 2 million points). csv: one row of the same. Progress "
      "is told on stderr.\n"
      "A file takes its place when it is whole. Ctrl-C: nothing is written, exit code 130. Exit "
      "code 1 where the load is\n"
      "balanced at no input.");
  return {command, [arguments](const GlobalOptions& global) { return run(*arguments, global); }};
}

}  // namespace helix_arm::cli
