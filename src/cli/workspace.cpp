#include "helix_arm/statics/workspace.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <future>
#include <iostream>
#include <sstream>
#include <thread>

#include "basics/median.hpp"
#include "command.hpp"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/statics/tier.hpp"
#include "io/document/atomic_file.hpp"
#include "measurements.hpp"
#include "procedures/report_plot.hpp"
#include "regulator/regulator_io.hpp"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "its PLY files are little-endian");

namespace helix_arm::cli {
namespace {

// Origin of a file of points.
struct CloudOrigin {
  std::string scene, tier;
  std::uint64_t seed = 1;
  bool sensitivity = false;
};

constexpr std::size_t kCountWidth = 20;  // digits of the largest count

bool isPly(const std::string& path) {
  const std::string end = std::filesystem::path(path).extension().string();
  refuseIf(end != ".ply" && end != ".csv", "--out ", path,
           " ends neither in .ply nor in .csv; expected one of them");
  return end == ".ply";
}

// Points as a PLY (binary, little-endian; tips and sensitivity as float32) or a CSV (inputs, tips
// and sensitivity, with units in the header).
class CloudFormat {
 public:
  CloudFormat(const model::Arm& arm, CloudOrigin origin, bool ply)
      : arm_(arm), origin_(std::move(origin)), ply_(ply) {}

  bool tellsCount() const { return ply_; }
  // Its length does not depend on the number of points.
  std::string header(std::uint64_t points) const { return ply_ ? plyHeader(points) : csvHeader(); }

  // Points as they stand behind the header. From any thread.
  std::string encode(const statics::WorkspacePoints& points) const {
    return ply_ ? encodePly(points) : encodeCsv(points);
  }

 private:
  std::string plyHeader(std::uint64_t points) const {
    const std::string count = std::to_string(points);
    std::ostringstream out;
    // The count is only known at the end; padding keeps the length of the header constant.
    out << "ply\nformat binary_little_endian 1.0\n"
        << "comment tips of arm " << origin_.scene << ", tier " << origin_.tier << ", seed "
        << origin_.seed << "\ncomment x, y, z in m, seen from the arm's base, x along the arm"
        << std::string(kCountWidth - count.size(), ' ') << "\nelement vertex " << count
        << "\nproperty float x\nproperty float y\nproperty float z\n";
    for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
      out << "property float " << statics::kSensitivityNames[k] << "\n";
    }
    out << "end_header\n";
    return out.str();
  }

  std::string csvHeader() const {
    std::ostringstream out;
    out << "# tips of arm " << origin_.scene << ", tier " << origin_.tier << ", seed "
        << origin_.seed << "\n# x, y, z seen from the arm's base, x along the arm\n";
    if (origin_.sensitivity) {
      out << "# tip displacement for an error of 1 kPa in every pressure, of 1 mm in every free "
             "length, of 1 % in the stiffness\n";
    }
    for (int i = 0; i < arm_.actuatorCount(); ++i) {
      const model::DriveUnit unit = model::unitOf(arm_.actuator(i).drive);
      out << unit.quantity << "_" << i + 1 << "_" << unit.suffix << ",";
    }
    out << "x_m,y_m,z_m";
    for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
      out << "," << statics::kSensitivityNames[k];
    }
    out << "\n";
    return out.str();
  }

  std::string encodePly(const statics::WorkspacePoints& points) const {
    const Eigen::Index columns = origin_.sensitivity ? 3 + statics::kSensitivities : 3;
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> out(points.count(),
                                                                              columns);
    out.leftCols(3) = points.tips.cast<float>();
    if (origin_.sensitivity) {
      out.rightCols(statics::kSensitivities) = points.sensitivity.cast<float>();
    }
    return {reinterpret_cast<const char*>(out.data()),
            static_cast<std::size_t>(out.size()) * sizeof(float)};
  }

  std::string encodeCsv(const statics::WorkspacePoints& points) const {
    constexpr int kInputDigits = 17;  // they read back as the same value
    constexpr int kTipDigits = 12;
    constexpr int kSensitivityDigits = 9;
    std::string out;
    const auto put = [&out](double value, int digits) {
      char text[32];
      const int size = std::snprintf(text, sizeof text, "%.*g,", digits, value);
      out.append(text, static_cast<std::size_t>(size));
    };
    for (int row = 0; row < points.count(); ++row) {
      for (int i = 0; i < arm_.actuatorCount(); ++i) {
        put(points.inputs(row, i) / model::unitOf(arm_.actuator(i).drive).scale, kInputDigits);
      }
      for (int k = 0; k < 3; ++k) put(points.tips(row, k), kTipDigits);
      for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
        put(points.sensitivity(row, k), kSensitivityDigits);
      }
      out.back() = '\n';
    }
    return out;
  }

  const model::Arm& arm_;
  const CloudOrigin origin_;
  const bool ply_;
};

constexpr std::uint64_t kUsualCount = 10000000;
constexpr std::uint64_t kUsualSensitiveCount = 200000;

// Arguments of `workspace`.
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

// Summary of the sampled points.
struct WorkspaceSummary {
  std::uint64_t inputs = 0, unbalanced = 0;
  std::uint64_t blocked = 0;  // too close to a zone
  double seconds = 0.0;
  statics::WorkspaceExtremes sampled;   // of the points
  statics::WorkspaceExtremes extremes;  // that a search found from there
  Eigen::Vector3d worst = Eigen::Vector3d::Zero();
  statics::WorkspacePoints kept;  // tips and sensitivity, for medians and maps
  bool whole = false;             // not interrupted

  std::uint64_t points() const { return inputs - unbalanced - blocked; }
  // Median of sensitivity k over the kept points [m]; there is at least one.
  double median(int k) const {
    const auto column = kept.sensitivity.col(k);
    return basics::medianOf({column.begin(), column.end()});
  }
};

// Number of points kept for medians and maps. The samples are evenly distributed, so the first ones
// represent all.
constexpr std::uint64_t kMostKept = 2000000;

// @param kept  rows of summary.kept that are points already.
void add(const statics::WorkspacePoints& points, Eigen::Index& kept, WorkspaceSummary& summary) {
  summary.inputs += static_cast<std::uint64_t>(points.count() + points.unbalanced);
  summary.unbalanced += static_cast<std::uint64_t>(points.unbalanced);
  if (points.count() == 0) return;
  summary.sampled.add(points);
  if (points.sensitivity.rows() > 0) {
    summary.worst =
        summary.worst.cwiseMax(points.sensitivity.colwise().maxCoeff().transpose()).eval();
  }
  const Eigen::Index more = std::min<Eigen::Index>(points.count(), summary.kept.count() - kept);
  summary.kept.tips.middleRows(kept, more) = points.tips.topRows(more);
  if (points.sensitivity.rows() > 0) {
    summary.kept.sensitivity.middleRows(kept, more) = points.sensitivity.topRows(more);
  }
  kept += more;
}

// Keeps the points at which the arm is clear of the zones. @return how many are not.
int keepClear(const clearance::SweepCheck& zones, statics::WorkspacePoints& points) {
  std::vector<Eigen::Index> clear;
  for (Eigen::Index row = 0; row < points.tips.rows(); ++row) {
    if (zones.isClear(points.inputs.row(row).transpose())) clear.push_back(row);
  }
  const int blocked = static_cast<int>(points.tips.rows()) - static_cast<int>(clear.size());
  points.inputs = points.inputs(clear, Eigen::all).eval();
  points.tips = points.tips(clear, Eigen::all).eval();
  if (points.sensitivity.rows() > 0) {
    points.sensitivity = points.sensitivity(clear, Eigen::all).eval();
  }
  return blocked;
}

// Samples on all threads and takes the pieces in their order, so that the result does not tell how
// many threads there were. Ends early when interrupted.
// @param zones  that the arm keeps out of, or null.
// @param format, file  for the points, committed if it is whole and has any; or null.
// @throws io::FileError where the file cannot be written.
WorkspaceSummary sampleWorkspace(const statics::Workspace& workspace,
                                 const WorkspaceArguments& arguments, const CloudFormat& format,
                                 io::AtomicFile* file, const clearance::SweepCheck* zones) {
  struct Piece {
    statics::WorkspacePoints points;
    std::string encoded;
    int blocked = 0;
  };
  const std::uint64_t total = arguments.inputs();
  const int size = workspace.pieceSize();  // small enough to react to Ctrl-C soon
  const auto make = [&, total, size](std::uint64_t first) {
    const auto count = static_cast<int>(std::min<std::uint64_t>(total - first, size));
    Piece piece{workspace.sample(first, count), {}};
    if (zones != nullptr) piece.blocked = keepClear(*zones, piece.points);
    if (file != nullptr) piece.encoded = format.encode(piece.points);
    return piece;
  };
  const std::size_t threads = arguments.threads > 0
                                  ? static_cast<std::size_t>(arguments.threads)
                                  : std::max(1u, std::thread::hardware_concurrency());
  WorkspaceSummary summary;
  Eigen::Index kept = 0;
  if (arguments.sensitivity || !arguments.png.empty()) {
    const auto most = static_cast<Eigen::Index>(std::min(total, kMostKept));
    summary.kept.tips.resize(most, 3);
    summary.kept.sensitivity.resize(arguments.sensitivity ? most : 0, 3);
  }
  if (file != nullptr) file->write(format.header(0));
  Progress progress("workspace", static_cast<double>(total), " inputs");
  const double start = regulator::steadyNow();
  std::deque<std::future<Piece>> pieces;
  std::uint64_t begun = 0;
  while (!interrupted() && summary.inputs < total) {
    while (begun < total && pieces.size() < threads) {
      pieces.push_back(std::async(std::launch::async, make, begun));
      begun += static_cast<std::uint64_t>(size);
    }
    const Piece piece = pieces.front().get();
    pieces.pop_front();
    if (file != nullptr) file->write(piece.encoded);
    add(piece.points, kept, summary);
    summary.inputs += static_cast<std::uint64_t>(piece.blocked);
    summary.blocked += static_cast<std::uint64_t>(piece.blocked);
    progress.reached(static_cast<double>(summary.inputs));
  }
  summary.seconds = regulator::steadyNow() - start;
  // The search for extremes knows nothing of zones.
  if (zones != nullptr) summary.extremes = summary.sampled;
  if (summary.points() > 0 && zones == nullptr) {
    summary.extremes = statics::findExtremes(workspace.model(), summary.sampled, interrupted);
  }
  summary.whole = !interrupted();
  summary.kept.tips.conservativeResize(kept, 3);
  summary.kept.sensitivity.conservativeResize(arguments.sensitivity ? kept : 0, 3);
  if (file != nullptr && summary.whole && summary.points() > 0) {
    if (format.tellsCount()) file->writeOver(0, format.header(summary.points()));
    file->commit();
  }
  return summary;
}

json reportOf(const io::Scene& scene, const statics::TierSetting& setting,
              const WorkspaceArguments& arguments, const WorkspaceSummary& summary) {
  const bool some = summary.points() > 0;
  json sensitivity;
  for (int k = 0; k < statics::kSensitivities && some && arguments.sensitivity; ++k) {
    sensitivity[statics::kSensitivityNames[k]] = {{"median", summary.median(k)},
                                                  {"max", summary.worst[k]}};
  }
  const auto bounds = [](const Eigen::AlignedBox3d& box) {
    return json{{"min", box.min()}, {"max", box.max()}};
  };
  json document{{"scene", scene.name},
                {"tier", statics::nameOf(setting.tier)},
                {"order", setting.order > 0 ? json(setting.order) : json()},
                {"seed", arguments.seed},
                {"count", summary.inputs},
                {"unbalanced", summary.unbalanced},
                {"failure", nullptr},
                {"seconds", summary.seconds},
                {"points_per_second", static_cast<double>(summary.inputs) / summary.seconds},
                {"out", textOrNull(some ? arguments.out : "")},
                {"png", textOrNull(some ? arguments.png : "")},
                {"sensitivity", sensitivity}};
  for (const char* key :
       {"bounds_m", "reach_m", "resolution_m", "sampled_bounds_m", "sampled_reach_m"}) {
    document[key] = nullptr;
  }
  if (some) {
    document["bounds_m"] = bounds(summary.extremes.bounds());
    document["reach_m"] = summary.extremes.reach();
    document["resolution_m"] = summary.extremes.beyond(summary.sampled);
    document["sampled_bounds_m"] = bounds(summary.sampled.bounds());
    document["sampled_reach_m"] = summary.sampled.reach();
  } else {
    document["failure"] = summary.blocked > 0
                              ? "the arm is too close to a zone of keep_out at every sampled input"
                              : "no shape balances the load at any sampled input";
  }
  if (scene.keep_out) document["blocked"] = summary.blocked;
  addResponse(scene.arm, model::ArmResponse(scene.arm), 0, document);
  return document;
}

// One row, from the report.
Csv csvOf(json& report) {
  Csv csv{{"scene", "tier", "order", "seed", "count", "unbalanced", "seconds"}};
  const auto addExtremes = [&](const std::string& prefix) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const std::string end : {"min", "max"}) {
        const std::string name = prefix + end + "_" + "xyz"[axis] + "_m";
        const json& bounds = report[prefix + "bounds_m"];
        report[name] = bounds.is_null() ? json() : bounds[end][axis];
        csv.columns.push_back(name);
      }
    }
    csv.columns.push_back(prefix + "reach_m");
  };
  addExtremes("");
  for (int k = 0; k < statics::kSensitivities && !report["sensitivity"].is_null(); ++k) {
    const std::string name = statics::kSensitivityNames[k];
    for (const std::string figure : {"median", "max"}) {
      csv.columns.emplace_back("sensitivity/" + name + "/" + figure, figure + "_" + name);
    }
  }
  addExtremes("sampled_");
  csv.columns.push_back("resolution_m");
  return csv;
}

// The report with what it means.
json shownOf(const io::Scene& scene, const statics::TierSetting& setting, json report) {
  report["tier"] = setting.name();
  for (const char* key : {"order", "response"}) report.erase(key);
  if (report["unbalanced"] == 0) report.erase("unbalanced");
  const char* const errors[] = {"kPa of pressure error", "mm of free length error",
                                "% of stiffness error"};
  json table;
  for (int k = 0; k < statics::kSensitivities && !report["sensitivity"].is_null(); ++k) {
    const json& sensitivity = report["sensitivity"][statics::kSensitivityNames[k]];
    table.push_back({{"name", std::string("tip displacement per ") + errors[k]},
                     {"median_m", sensitivity["median"]},
                     {"max_m", sensitivity["max"]}});
  }
  report["sensitivity"] = table;
  const std::string note = noteOnResponse(scene.arm);
  if (!note.empty()) report["notes"].push_back(note);
  return report;
}

constexpr double kLeastWidth = 1e-3;  // of a map, as a part of its length; plot_report has it too
constexpr std::uint64_t kMostCount = 10000000000;
constexpr int kMostThreads = 256;

void drawMaps(const WorkspaceArguments& arguments, const CloudFormat& format,
              const CloudOrigin& origin, const WorkspaceSummary& summary) {
  const auto& tips = summary.kept.tips;
  Eigen::Array3d sides = tips.colwise().maxCoeff() - tips.colwise().minCoeff();
  std::sort(sides.begin(), sides.end());
  refuseIf(!(sides[2] > 0) || sides[1] < kLeastWidth * sides[2], "--png ", arguments.png,
           " has nothing to draw: the ", summary.points(),
           summary.points() == 1 ? " tip is" : " tips lie on",
           " a line or a point; sample more with --count, or leave out --png");
  const auto count = static_cast<std::uint64_t>(summary.kept.count());
  const json report{{"scene", origin.scene},
                    {"tier", origin.tier},
                    {"reach_m", summary.extremes.reach()},
                    {"cloud", "cloud.ply"}};
  procedures::drawReport(report.dump(), arguments.png, "leave out --png",
                         {"cloud.ply", format.header(count) + format.encode(summary.kept)});
}

statics::Workspace workspaceOf(const io::Scene& scene, const WorkspaceArguments& arguments) {
  refuseIf(arguments.sensitivity && hasTendon(scene.arm), "--sensitivity is per kPa, and scene ",
           scene.name, " has tendons; leave out --sensitivity");
  return statics::Workspace(modelOf(scene, arguments.tier),
                            {arguments.seed, arguments.sensitivity});
}

int run(const WorkspaceArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  const statics::Workspace workspace = workspaceOf(scene, arguments);
  const statics::TierSetting& setting = workspace.model().choice().setting;
  requireWritable({arguments.png});
  std::optional<clearance::SweepCheck> zones;
  if (scene.keep_out) zones.emplace(workspace.model(), *scene.keep_out);
  const CloudOrigin origin{scene.name, setting.name(), arguments.seed, arguments.sensitivity};
  WorkspaceSummary summary;
  {
    const InterruptWatch watch;
    const CloudFormat format(scene.arm, origin, !arguments.out.empty() && isPly(arguments.out));
    std::optional<io::AtomicFile> file;
    if (!arguments.out.empty()) file.emplace(arguments.out);
    summary = sampleWorkspace(workspace, arguments, format, file ? &*file : nullptr,
                              zones ? &*zones : nullptr);
  }
  if (!summary.whole) {
    std::cerr << "interrupted after " << summary.inputs << " of " << arguments.inputs()
              << " inputs; nothing was written\n";
    return kInterrupted;
  }
  const bool some = summary.points() > 0;
  if (!arguments.png.empty() && some) {
    drawMaps(arguments, CloudFormat(scene.arm, origin, true), origin, summary);
  }
  const json report = reportOf(scene, setting, arguments, summary);
  printResult(global.format, report, shownOf(scene, setting, report),
              [table = report](std::ostream& out) mutable {
                const Csv csv = csvOf(table);
                printCsv(table, csv, out);
              });
  return some ? kDone : kNotPossible;
}

}  // namespace

void addWorkspace(Commands& commands) {
  auto [command, arguments] = commands.add<WorkspaceArguments>(
      "workspace", "reachable tip positions, and their sensitivity to errors", run);
  addScene(command, arguments.scene);
  addOption(command, "--out", arguments.out,
            "file for the points: .ply (binary, float32) or .csv (with the inputs); default: "
            "summary only");
  addOption(command, "--png", arguments.png, "picture file for maps of the points");
  addOption(command, "--count", arguments.count,
            "number of inputs to sample, evenly within their limits; default 10000000, or 200000 "
            "with --sensitivity",
            CLI::Range(std::uint64_t{1}, kMostCount));
  command.add_flag(
      "--sensitivity", arguments.sensitivity,
      "also the tip displacement [m] per error of pressure, length and stiffness, at every point");
  addOption(command, "--seed", arguments.seed, "seed of the inputs", kShowDefault);
  addOption(command, "--threads", arguments.threads,
            "number of sampling threads, 0: one per core; the points do not depend on it",
            CLI::Range(0, kMostThreads), kShowDefault);
  addTierOptions(command, arguments.tier);
  command.footer(
      R"(bounds_m and reach_m are the largest values of a search from the farthest of the sampled
points and of corners of the limits (1024, under load 128, exact tier 8): each is a tip
position of the arm; nothing proves that there is none beyond. sampled_*: of the sampled
points alone. resolution_m: largest distance from these to what the search found, by
which the points miss the border at least.
Sensitivity: tip displacement [m] for an error of 1 kPa in every pressure (per_kpa_m),
of 1 mm in every free length (per_mm_m), of 1 % in every entry of the stiffness, under
load also K_eps (per_percent_K_m).
The errors are independent: roots of sums of squares. Not for arms with tendons.
json: scene, tier, order, seed, count (inputs), unbalanced (inputs omitted because no
shape balances the load there or, with --sensitivity, with 1 % more stiffness), failure
(null if there are points), seconds, points_per_second, bounds_m {min, max}, reach_m
(largest distance from the base), sampled_bounds_m, sampled_reach_m, resolution_m, out,
png, sensitivity (null, or for each {median, max}; medians and maps are of the first 2
million points). csv: one row of the same. Progress is printed on stderr.
Of a scene with keep_out, points at which the arm is too close to a zone are left out: json
counts them as blocked, and bounds and reach are those of the sampled points.
A file appears only when it is complete. Ctrl-C: nothing is written, exit code 130. Exit
code 1 if no input balances the load.)");
}

}  // namespace helix_arm::cli
