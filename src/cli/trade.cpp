#include <algorithm>
#include <filesystem>
#include <iostream>
#include <limits>

#include "basics/median.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "helix_arm/statics/tier.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "io/document/atomic_file.hpp"
#include "procedures/report_plot.hpp"
#include "regulator/regulator_io.hpp"
#include "simulation/rig.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;
using statics::Tier;
using vision::TrackingMode;

constexpr int kMostPictures = 10000;
// Errors below this fraction of the arm's length are rounding and count as equal. plot_report uses
// the same.
constexpr double kRounding = 1e-13;

constexpr int kCorners = 100;
constexpr int kInner = 300;
constexpr int kDrawnShapes = 8;
constexpr int kDenseFactor = 16;  // reference points per segment of a drawn line

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Cost and error of one way to compute, draw or measure the arm's shape.
struct TradeRow {
  std::string part;     ///< model, curve, sight or fit: rows of one part compete with each other
  std::string tier;     ///< of the part
  std::string setting;  ///< of the tier; empty where it has none
  double time = 0;      ///< median of one answer [s]
  double error = 0;     ///< as a part of the arm's length; infinite where there is no answer
  bool on_frontier = false;
};

void append(const std::vector<TradeRow>& more, std::vector<TradeRow>& rows) {
  rows.insert(rows.end(), more.begin(), more.end());
}

// For a scene without load: the loaded tiers are measured all the same.
statics::Load loadOf(const io::Scene& scene) {
  if (scene.model.load()) return *scene.model.load();
  statics::Load none;
  none.mass.assign(scene.arm.sectionCount(), 0.0);
  none.K_eps.assign(scene.arm.sectionCount(), 1.0);
  return none;
}

std::vector<statics::TierSetting> settingsOf(const io::Scene& scene, const statics::Load& load) {
  std::vector<statics::TierSetting> out;
  for (const Tier tier : statics::kTiers) {
    if (tier == Tier::kPlanar && !(scene.planar && statics::inPlane(load))) continue;
    const bool loaded = tier == Tier::kLoaded;
    const int first = loaded ? statics::kLeastOrder : 0, last = loaded ? statics::kMostOrder : 0;
    for (int order = first; order <= last; ++order) out.push_back({tier, order});
  }
  return out;
}

// Largest distance of the reference points from the line through every kDenseFactor-th of them.
double lineError(const std::vector<Eigen::Vector3d>& meant) {
  double largest = 0.0;
  for (std::size_t i = 0; i + kDenseFactor < meant.size(); i += kDenseFactor) {
    const Eigen::Vector3d from = meant[i], along = meant[i + kDenseFactor] - from;
    for (int j = 1; j < kDenseFactor; ++j) {
      const Eigen::Vector3d there = meant[i + j] - from;
      const double t = std::clamp(there.dot(along) / along.squaredNorm(), 0.0, 1.0);
      largest = std::max(largest, (there - t * along).norm());
    }
  }
  return largest;
}

// Points of the curve, and of each muscle along it, at `points` positions per section.
void drawMuscles(const model::Arm& arm, const std::vector<model::CurvePoint<lie::SE3>>& curve,
                 int points, std::vector<std::vector<Eigen::Vector3d>>& lines) {
  lines.resize(arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      lines[i].clear();
      for (int j = k * points; j <= (k + 1) * points; ++j) {
        lines[i].push_back(
            curve[j].X *
            model::poseAlong(arm.actuator(i), static_cast<double>(j - k * points) / points)
                .translation);
      }
    }
  }
}

// Every tier and order: largest error of the tip against the exact tier, at sampled inputs. No rows
// where the load finds no balance at any of them.
std::vector<TradeRow> modelRows(const io::Scene& scene) {
  const statics::Load load = loadOf(scene);
  const statics::ExactArm exact(scene.arm, load);
  std::vector<Eigen::VectorXd> inputs;
  std::vector<Eigen::Vector3d> tips;
  for (const Eigen::VectorXd& q : statics::sampleInputs(scene.arm, kCorners, kInner)) {
    const statics::Solution solution = exact.solve(statics::unloadedUnder(scene.arm, load, q));
    if (!solution.converged()) continue;
    inputs.push_back(q);
    tips.push_back(solution.tip.translation);
  }
  std::vector<TradeRow> rows;
  if (inputs.empty()) return rows;
  for (const statics::TierSetting& setting : settingsOf(scene, load)) {
    const statics::ArmModel tier(scene.arm, scene.planar, load, setting);
    double error = 0.0;
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      const statics::Tip found = tier.tip(inputs[i]);
      error =
          std::max(error, found.converged() ? (found.tip.translation - tips[i]).norm() : kInfinity);
    }
    std::size_t next = 0;
    const double time = basics::medianTime([&] {
      tier.tip(inputs[next]);
      next = next + 1 < inputs.size() ? next + 1 : 0;
    });
    rows.push_back({"model", nameOf(setting.tier),
                    setting.tier == Tier::kLoaded ? "order " + std::to_string(setting.order) : "",
                    time, error / scene.arm.restLength()});
  }
  return rows;
}

// Curves and tubes of muscles drawn from ever more points: largest distance of what is drawn from
// what is meant.
std::vector<TradeRow> drawingRows(const io::Scene& scene) {
  const model::Arm& arm = scene.arm;
  std::vector<model::Shape> shapes;
  for (const Eigen::VectorXd& q : statics::sampleInputs(arm, 0, kDrawnShapes)) {
    statics::Solution solution = scene.model.solve(q);
    if (solution.converged()) shapes.push_back(std::move(solution.shape));
  }
  std::vector<TradeRow> rows, markers;
  if (shapes.empty()) return rows;
  std::vector<std::vector<Eigen::Vector3d>> lines;
  for (const int points : {4, 8, 16, 24, 48, 96}) {
    const int sections = arm.sectionCount();
    double curve_error = 0.0, muscle_error = 0.0;
    for (const model::Shape& shape : shapes) {
      const auto dense = model::sampleCurve(shape, sections * points * kDenseFactor + 1);
      std::vector<Eigen::Vector3d> curve;
      for (const auto& point : dense) curve.push_back(point.X.translation);
      curve_error = std::max(curve_error, lineError(curve));
      drawMuscles(arm, dense, points * kDenseFactor, lines);
      for (const auto& line : lines) muscle_error = std::max(muscle_error, lineError(line));
    }
    const double curve_time =
        basics::medianTime([&] { model::sampleCurve(shapes.back(), sections * points + 1); });
    const double muscle_time = basics::medianTime([&] {
      drawMuscles(arm, model::sampleCurve(shapes.back(), sections * points + 1), points, lines);
    });
    const std::string setting = std::to_string(points) + " points per section";
    rows.push_back({"curve", "base curve", setting, curve_time, curve_error / arm.restLength()});
    markers.push_back(
        {"markers", "muscles", setting, muscle_time, muscle_error / arm.restLength()});
  }
  append(markers, rows);
  return rows;
}

// Pictures of the simulated rig in a fast motion, 30 per second.
struct Film {
  std::vector<cv::Mat> pictures;
  std::vector<model::Shape> truth, model;
};

Film shoot(const io::Scene& scene, int count) {
  const simulation::CameraSetup setup = *scene.cameraSetup();
  const simulation::TrueArm true_arm(scene.model, scene.simulation.arm);
  simulation::SimulatedCamera camera(setup.view, setup.family, setup.body, setup.config);
  Film film;
  Eigen::VectorXd share(scene.arm.actuatorCount());
  for (int i = 0; i < count; ++i) {
    // Each actuator oscillates over its range with its own frequency, about once in three seconds.
    for (int k = 0; k < share.size(); ++k) {
      share[k] = 0.5 + 0.48 * std::sin((0.06 + 0.01 * (k % 5)) * i + 2 * k);
    }
    const Eigen::VectorXd q = scene.arm.inputAt(share);
    const statics::Solution expected = scene.model.solve(q);
    if (!expected.converged()) continue;
    film.model.push_back(expected.shape);
    film.truth.push_back(true_arm.shape(q));
    film.pictures.push_back(camera.render(film.truth.back()).clone());
  }
  return film;
}

// Median time and error of a tip that is found in each picture, or not.
TradeRow rowOf(const io::Scene& scene, const Film& film, TradeRow row,
               const std::function<std::optional<Eigen::Vector3d>(std::size_t)>& tipIn) {
  std::vector<double> times, errors;
  for (std::size_t i = 0; i < film.pictures.size(); ++i) {
    const double begin = regulator::steadyNow();
    const std::optional<Eigen::Vector3d> tip = tipIn(i);
    times.push_back(regulator::steadyNow() - begin);
    errors.push_back(tip ? (*tip - model::tipPose(film.truth[i]).translation).norm() : kInfinity);
  }
  row.time = basics::medianOf(times);
  row.error = basics::medianOf(errors) / scene.arm.restLength();
  return row;
}

const char* nameOf(TrackingMode mode) {
  if (mode == TrackingMode::kFull) return "whole picture";
  return mode == TrackingMode::kRegions ? "regions" : "edges";
}

TradeRow searchRow(const io::Scene& scene, const Film& film, TrackingMode mode, double decimate) {
  vision::LocalizerConfig config = scene.vision;
  config.tracking = mode;
  config.detector.quad_decimate = decimate;
  vision::ArmLocalizer localizer(scene.view(), config);
  const auto tipIn = [&](std::size_t i) -> std::optional<Eigen::Vector3d> {
    const vision::Observation& seen = localizer.locate(film.pictures[i], film.model[i]);
    if (seen.state != vision::ObservationState::kMeasured) return std::nullopt;
    return model::tipPose(seen.fit.shape).translation;
  };
  return rowOf(scene, film, {"sight", nameOf(mode), basics::format("quad_decimate %g", decimate)},
               tipIn);
}

// Parameters that a fit estimates in addition to the shape.
struct FitMode {
  const char* setting;
  bool free_base, free_border_shift, cold;
};

// The corners of all pictures are detected once, so that only the fit is timed.
std::vector<TradeRow> fitRows(const io::Scene& scene, const Film& film) {
  const estimation::ArmView view = scene.view();
  const double focal = view.camera.focal();
  vision::TagDetector detector(scene.vision.detector);
  std::vector<std::vector<estimation::CornerObservation>> seen;
  for (const cv::Mat& picture : film.pictures) {
    seen.emplace_back();
    for (const vision::TagDetection& detection : detector.detect(picture)) {
      const int tag = view.layout.find(detection.id);
      if (tag < 0) continue;
      const auto direction = estimation::directionsOf(view.camera, detection.corners);
      if (direction) seen.back().push_back({tag, *direction});
    }
  }
  std::vector<TradeRow> rows;
  for (const FitMode& mode :
       {FitMode{"from the model", false, false, false}, FitMode{"base free", true, false, false},
        FitMode{"bleed free", false, true, false},
        FitMode{"base and bleed free", true, true, false}, FitMode{"cold", false, false, true}}) {
    estimation::TwistFitOptions options = scene.vision.fit;
    options.free_base = mode.free_base;
    options.free_border_shift = mode.free_border_shift;
    estimation::TwistFitter fitter(view.layout, view.sections, options);
    const auto tipIn = [&](std::size_t i) -> std::optional<Eigen::Vector3d> {
      const estimation::TwistFit& fit =
          mode.cold ? fitter.fitCold(seen[i], view.X_CB, focal, film.model[i])
                    : fitter.fit(seen[i], view.X_CB, focal, film.model[i]);
      if (fit.status != estimation::FitStatus::kConverged) return std::nullopt;
      return fit.X_B0B * model::tipPose(fit.shape).translation;
    };
    rows.push_back(rowOf(scene, film, {"fit", "corners", mode.setting}, tipIn));
  }
  return rows;
}

// Every way to search a picture, and to fit the shape to what it found: median error of the tip
// over rendered pictures (> 0) of the moving arm, against the true one; of a scene with camera and
// tags. No rows where the scene's tier finds no shape at any picture.
std::vector<TradeRow> visionRows(const io::Scene& scene, int pictures) {
  const Film film = shoot(scene, pictures);
  std::vector<TradeRow> rows;
  if (film.pictures.empty()) return rows;
  for (const double decimate : {1.0, 1.5, 2.0, 3.0, 4.0}) {
    for (const TrackingMode mode :
         {TrackingMode::kFull, TrackingMode::kRegions, TrackingMode::kEdges}) {
      rows.push_back(searchRow(scene, film, mode, decimate));
    }
  }
  append(fitRows(scene, film), rows);
  return rows;
}

// Marks the rows that no other row of their part beats in time without being worse in error.
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

struct TradeOptions {
  std::string scene, out;
  int pictures = 60;
  bool no_files = false;
};

// {scene, rows, notes}: notes are on parts that could not be measured.
json measure(const io::Scene& scene, const TradeOptions& options) {
  std::vector<TradeRow> rows = modelRows(scene);
  json notes = json::array();
  if (rows.empty()) {
    notes.push_back(
        "no shape balances the scene's load at any sampled input, so there is nothing to measure; "
        "check load and K_eps_n: less load, or stiffer muscles");
  } else {
    append(drawingRows(scene), rows);
    if (options.pictures == 0) {
      notes.push_back("no pictures were requested: sight and fit are not measured");
    } else if (!scene.camera || !scene.tags) {
      notes.push_back("the scene has no camera or no tags: sight and fit are not measured");
    } else {
      const std::vector<TradeRow> seen = visionRows(scene, options.pictures);
      append(seen, rows);
      if (seen.empty()) {
        notes.push_back(
            "the scene's tier finds no shape to start from at any picture: sight and fit are not "
            "measured");
      }
    }
    markFrontier(rows);
  }
  const json table = listJson(rows, [](const TradeRow& row) -> json {
    return {{"part", row.part},
            {"tier", row.tier},
            {"setting", row.setting},
            {"time_ns", 1e9 * row.time},
            {"tip_error_percent", 100 * row.error},
            {"on_frontier", row.on_frontier}};
  });
  return {{"scene", scene.name}, {"rows", table}, {"notes", notes}};
}

fs::path makeFolder(const TradeOptions& options, const std::string& scene) {
  fs::path folder = options.out.empty() ? "trade_" + scene : options.out;
  std::error_code error;
  fs::create_directories(folder, error);
  refuseIf(!fs::is_directory(folder), "--out ", folder.string(),
           " cannot be created: ", error.message(), "; choose another folder");
  return folder;
}

int run(const TradeOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  std::optional<fs::path> folder;
  if (!options.no_files) folder = makeFolder(options, scene.name);
  const json report = measure(scene, options);
  const Csv table{{"part", "tier", "setting", "time_ns", "tip_error_percent", "on_frontier"},
                  "rows"};
  json shown = report;
  shown["notes"].push_back(
      "tip errors in % of the arm's length; on the frontier: no faster row of "
      "the same part is as accurate");
  printResult(global.format, report, shown, table);
  if (report["rows"].empty()) return kNotPossible;
  if (!folder) return kDone;
  io::writeFileAtomically(*folder / "trade.csv", csvText("", report, table));
  io::writeFileAtomically(*folder / "trade.json", report.dump(2) + "\n");
  procedures::drawReport(report.dump(), *folder / "trade.png", "leave it out with --no-files");
  std::cerr << "wrote trade.csv, trade.json and trade.png to " << folder->string() << "\n";
  return kDone;
}

}  // namespace

void addTrade(Commands& commands) {
  auto [command, options] = commands.add<TradeOptions>(
      "trade", "measure accuracy against time on this scene and machine", run);
  addScene(command, options.scene);
  addOption(command, "--out", options.out,
            "folder for trade.csv, trade.json and trade.png, created if absent; default: trade_ "
            "and the scene's name");
  command.add_flag("--no-files", options.no_files, "only print, write no files");
  addOption(command, "--pictures", options.pictures,
            "number of pictures rendered to measure sight and fit; 0 omits both",
            CLI::Range(0, kMostPictures), kShowDefault);
  command.footer(
      R"(Parts: model (largest tip error against the exact tier, over sampled inputs), curve and
markers (largest distance between what is drawn and the exact curve), sight and fit
(median tip error over rendered pictures, against the true arm of the simulation). Times
are medians on this machine.
json: rows [{part, tier, setting, time_ns, tip_error_percent (null: no answer),
on_frontier}], notes.
csv: the rows. Exit code 1, without rows or files, if no shape balances the load at any
sampled input.)");
}

}  // namespace helix_arm::cli
