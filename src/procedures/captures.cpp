#include "captures.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <variant>

#include "basics/text.hpp"
#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "io/document/number.hpp"

namespace helix_arm::procedures {
namespace {

struct NamedKind {
  DataKind kind;
  const char* column;  // which identifies the kind
  const char* text;
};

constexpr NamedKind kKinds[] = {
    {DataKind::kCurvatures, "curvature_rad", "curvatures"},
    {DataKind::kTagPoses, "x_m", "tag poses"},
    {DataKind::kTagCorners, "x1_px", "tag corners"},
    {DataKind::kLengths, "length_m", "free lengths"},
};

[[noreturn]] void refuse(const std::string& file, const std::string& fault) {
  throw io::DocumentError(file + " " + fault);
}

std::string kilopascalText(double pressure) {
  return io::formatNumber(io::kilopascals(pressure)) + " kPa";
}

std::optional<std::string> limitFault(const model::Actuator& actuator, int number,
                                      double pressure) {
  if (actuator.limits.contains(pressure)) return std::nullopt;
  return "pressure_" + std::to_string(number) + "_kpa is not within the limits of " +
         actuator.name + ", " + kilopascalText(actuator.limits.lower) + " to " +
         kilopascalText(actuator.limits.upper);
}

const estimation::TagLayout& tagsOf(const io::Scene& scene, const std::string& file) {
  if (scene.tags) return *scene.tags;
  refuse(file,
         "holds tags, but scene " + scene.name + " has none; expected a scene with a section tags");
}

std::string idsOf(const estimation::TagLayout& layout) {
  std::vector<int> ids;
  for (const estimation::TagPlacement& tag : layout.tags) ids.push_back(tag.id);
  return io::listOf(ids);
}

// Converts readings by tag id to readings by tag of the layout.
template <class Observation>
class TagReadings {
 public:
  explicit TagReadings(const io::Scene& scene, const std::string& file)
      : scene_(scene), file_(file), layout_(tagsOf(scene, file)) {}

  // observe(tag) returns the observation of a tag of the scene, absent if it was reported as a
  // fault.
  template <class Tags, class Observe>
  void add(int number, const Eigen::VectorXd& pressure, std::optional<double> time,
           const Tags& tags, Observe observe) {
    std::vector<Observation> reading;
    for (const auto& tag : tags) {
      const int index = layout_.find(tag.id);
      if (index < 0) {
        unknown_.insert(tag.id);
        continue;
      }
      known_ = true;
      if (const auto seen = observe(tag)) reading.push_back({index, *seen});
    }
    loaded_.captures.push_back({number, pressure, std::move(reading), time});
  }

  LoadedCaptures take() {
    loaded_.unknown_ids.assign(unknown_.begin(), unknown_.end());
    if (!known_ && !unknown_.empty()) {
      refuse(file_, "holds no tag of scene " + scene_.name + " but only " +
                        io::listOf(loaded_.unknown_ids) + "; expected " + idsOf(layout_) +
                        ": is it of another arm?");
    }
    return std::move(loaded_);
  }

 private:
  const io::Scene& scene_;
  const std::string& file_;
  const estimation::TagLayout& layout_;
  LoadedCaptures loaded_;
  std::set<int> unknown_;
  bool known_ = false;
};

LoadedCaptures curvaturesOf(const io::Scene& scene, const io::DataSet& data,
                            const Eigen::MatrixXd& pressures) {
  if (scene.arm.sectionCount() != 1) {
    refuse(data.path, "holds curvatures, which apply to arms of one section, but scene " +
                          scene.name + " has " + std::to_string(scene.arm.sectionCount()));
  }
  io::FaultList faults(data.path);
  LoadedCaptures loaded;
  const int column = data.find("curvature_rad");
  for (int row = 0; row < data.values.rows(); ++row) {
    const double curvature = data.values(row, column);
    if (curvature < 0) {
      faults.add(data.lines[row], "curvature_rad is negative; expected a finite value >= 0");
    }
    loaded.captures.push_back(
        {row + 1, pressures.row(row), estimation::CurvatureReading{curvature}});
  }
  faults.throwIfAny();
  return loaded;
}

// @param captures  poses seen from the base.
LoadedCaptures posesOf(const io::Scene& scene, const std::vector<io::TagPoseCapture>& captures,
                       const std::string& name) {
  TagReadings<estimation::PoseObservation> readings(scene, name);
  for (const io::TagPoseCapture& capture : captures) {
    readings.add(capture.number, capture.pressure, capture.time, capture.tags,
                 [](const io::TagPose& tag) { return std::optional(tag.X_BT); });
  }
  return readings.take();
}

// Directions of a tag's corners; absent, with a fault, where the distortion cannot be inverted.
std::optional<estimation::Corners> directionsOf(const estimation::Camera& camera,
                                                const io::TagCorners& tag, io::FaultList& faults) {
  estimation::Corners directions;
  for (int i = 0; i < tag.corners.cols(); ++i) {
    const auto direction = camera.directionOf(tag.corners.col(i));
    if (!direction) {
      const std::string number = std::to_string(i + 1);
      faults.add(tag.line, "x" + number + "_px, y" + number +
                               "_px are outside the picture; expected a point where the camera's "
                               "distortion can be inverted");
      return std::nullopt;
    }
    directions.col(i) = *direction;
  }
  return directions;
}

// Pressures about their limits count as at them; those far beyond are kept, as in another unit.
LoadedCaptures withNearPressures(LoadedCaptures loaded, const model::Arm& arm) {
  for (estimation::Capture& capture : loaded.captures) {
    const Eigen::VectorXd inside = arm.clamped(capture.pressure);
    for (Eigen::Index i = 0; i < inside.size(); ++i) {
      double& pressure = capture.pressure[i];
      if (std::abs(inside[i] - pressure) <= estimation::kBeyondLimit) pressure = inside[i];
    }
  }
  return loaded;
}

void requirePressures(const std::string& file, const model::Arm& arm) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (model::isPressure(arm.actuator(i).drive)) continue;
    refuse(file, "gives pressures, but actuator " + arm.actuator(i).name +
                     " of the scene is a tendon; expected an arm driven by pressure");
  }
}

Eigen::MatrixXd pressuresOf(const io::DataSet& data, const model::Arm& arm) {
  requirePressures(data.path, arm);
  return io::pressuresOf(data, arm.actuatorCount());
}

// By the columns of a row; of no effect without them. @return a fault, if there is one.
std::optional<std::string> readHung(const io::Scene& scene, const io::DataSet& data,
                                    Eigen::Index row, statics::PointLoad& out) {
  const auto cell = [&](const char* column, double absent) {
    const int at = data.find(column);
    return at < 0 ? absent : data.values(row, at);
  };
  const int sections = scene.arm.sectionCount();
  const double s = cell("load_s", sections);
  if (s < 0 || s > sections) {
    return "load_s is not on the arm; expected 0, at its base, to " + std::to_string(sections) +
           ", at its tip";
  }
  out.section = std::min(static_cast<int>(s), sections - 1);
  out.s = s - out.section;
  if (s == sections) out.offset = scene.arm.link(out.section).translation;
  out.mass = cell("load_mass_kg", 0.0);
  if (out.mass < 0) return "load_mass_kg is negative; expected a mass >= 0";
  if (out.mass > 0 && scene.model.load()->gravity.isZero(0)) {
    return "load_mass_kg has no weight, since the scene's load has no gravity; expected a scene "
           "with its section load, or load_force_x_n .. load_force_z_n";
  }
  const Eigen::Vector3d force(cell("load_force_x_n", 0), cell("load_force_y_n", 0),
                              cell("load_force_z_n", 0));
  out.force = scene.X_WB.rotation.transpose() * force;
  for (const statics::PointLoad& own : scene.model.load()->points) {
    const bool here = own.section == out.section && std::abs(own.s - out.s) < 1e-9;
    if (!here || (own.mass == 0 && own.force.isZero(0))) continue;
    if (own.mass != out.mass || !own.force.isApprox(out.force, 1e-9)) {
      return "hangs another load than the scene's load has at this place; leave it out of the "
             "scene";
    }
    out.mass = 0;
    out.force.setZero();
  }
  return std::nullopt;
}

}  // namespace

DataKind kindOf(const io::DataSet& data) {
  const NamedKind* found = nullptr;
  for (const NamedKind& kind : kKinds) {
    if (data.find(kind.column) < 0) continue;
    if (found != nullptr) {
      refuse(data.path, std::string("has columns ") + found->column + " of " + found->text +
                            " and " + kind.column + " of " + kind.text +
                            "; expected only one of them");
    }
    found = &kind;
  }
  if (found != nullptr) {
    // Poses and series have columns of positions alike.
    if (found->kind != DataKind::kTagPoses || data.find("tag") >= 0) return found->kind;
    if (data.find("time_s") >= 0) return DataKind::kTipSeries;
    refuse(data.path,
           "has positions, but neither a column time_s of a series of the tip nor a "
           "column tag of tag poses; expected one of them");
  }
  std::vector<std::string> known;
  for (const NamedKind& kind : kKinds)
    known.push_back(std::string(kind.column) + " of " + kind.text +
                    (kind.kind == DataKind::kTagPoses ? " or a series of the tip" : ""));
  refuse(data.path, "has none of the columns that identify its kind of data; expected " +
                        basics::joined(known) + ": convert what it has, and rename its columns");
}

Eigen::MatrixXd pressuresWithinLimits(const io::DataSet& data, const model::Arm& arm) {
  Eigen::MatrixXd pressures = pressuresOf(data, arm);
  io::FaultList faults(data.path);
  for (int row = 0; row < pressures.rows(); ++row) {
    for (int i = 0; i < pressures.cols(); ++i) {
      const auto fault = limitFault(arm.actuator(i), i + 1, pressures(row, i));
      if (fault) faults.add(data.lines[row], *fault);
    }
  }
  faults.throwIfAny();
  return pressures;
}

std::map<int, statics::PointLoad> payloadsOf(const io::Scene& scene, const io::DataSet& data) {
  static const std::vector<std::string> kColumns{"load_mass_kg", "load_force_x_n", "load_force_y_n",
                                                 "load_force_z_n", "load_s"};
  const auto known = std::count_if(kColumns.begin(), kColumns.end(),
                                   [&](const auto& name) { return data.find(name) >= 0; });
  const auto named = std::count_if(data.columns.begin(), data.columns.end(),
                                   [](const auto& name) { return name.rfind("load_", 0) == 0; });
  if (named == 0) return {};
  if (known != named)
    refuse(data.path, "has columns load_.. other than " + basics::joined(kColumns));
  if (!scene.model.load()) {
    refuse(data.path, "hangs loads on the arm, but scene " + scene.name +
                          " has no K_eps; expected arm.stiffness.K_eps_n");
  }
  io::FaultList faults(data.path);
  std::map<int, statics::PointLoad> out;
  const int column = data.find("capture");
  for (Eigen::Index row = 0; row < data.values.rows(); ++row) {
    statics::PointLoad point;
    if (const auto fault = readHung(scene, data, row, point)) faults.add(data.lines[row], *fault);
    const auto number = static_cast<int>(column < 0 ? row + 1 : data.values(row, column));
    const statics::PointLoad& first = out.emplace(number, point).first->second;
    if (first.mass != point.mass || first.force != point.force || first.s != point.s) {
      faults.add(data.lines[row], "hangs another load than the first row of its capture");
    }
  }
  faults.throwIfAny();
  for (auto one = out.begin(); one != out.end();) {
    const bool none = one->second.mass == 0 && one->second.force.isZero(0);
    one = none ? out.erase(one) : std::next(one);
  }
  return out;
}

statics::ArmModel modelUnder(const io::Scene& scene,
                             const std::optional<statics::PointLoad>& payload) {
  if (!payload) return scene.model;
  const estimation::ArmCaptures arm = makeArmCaptures(scene, {}).under(payload);
  return {arm.arm, std::nullopt, arm.load, arm.tier};
}

LoadedCaptures loadCaptures(const io::Scene& scene, const io::DataSet& data,
                            OutsideLimits outside) {
  const DataKind kind = kindOf(data);
  if (kind == DataKind::kLengths) {
    refuse(data.path, "holds free lengths of a muscle; expected measurements of an arm");
  }
  if (kind == DataKind::kTipSeries) {
    refuse(data.path, "holds a series of the tip; expected captures of an arm at rest");
  }
  const Eigen::MatrixXd pressures = outside == OutsideLimits::kFault
                                        ? pressuresWithinLimits(data, scene.arm)
                                        : pressuresOf(data, scene.arm);
  const int actuators = scene.arm.actuatorCount();
  LoadedCaptures loaded =
      kind == DataKind::kCurvatures ? curvaturesOf(scene, data, pressures)
      : kind == DataKind::kTagPoses
          ? posesOf(scene, io::loadTagPoses(data, actuators, scene.X_BF), data.path)
          : makeCaptures(scene, io::loadTagCorners(data, actuators), data.path);
  const std::map<int, statics::PointLoad> payloads = payloadsOf(scene, data);
  for (estimation::Capture& capture : loaded.captures) {
    const auto found = payloads.find(capture.number);
    if (found != payloads.end()) capture.payload = found->second;
  }
  return withNearPressures(std::move(loaded), scene.arm);
}

LoadedCaptures makeCaptures(const io::Scene& scene, const std::vector<io::TagCornerCapture>& seen,
                            const std::string& name) {
  requirePressures(name, scene.arm);
  if (!scene.camera) {
    refuse(name, "holds corners in pictures, but scene " + scene.name +
                     " has no camera; expected a scene with a section camera");
  }
  io::FaultList faults(name);
  TagReadings<estimation::CornerObservation> readings(scene, name);
  for (const io::TagCornerCapture& capture : seen) {
    const int line = capture.tags.empty() ? 0 : capture.tags.front().line;
    if (capture.pressure.size() != scene.arm.actuatorCount()) {
      faults.add(line, "has " + std::to_string(capture.pressure.size()) + " pressures in capture " +
                           std::to_string(capture.number) + "; expected " +
                           std::to_string(scene.arm.actuatorCount()));
      continue;
    }
    readings.add(
        capture.number, capture.pressure, capture.time, capture.tags,
        [&](const io::TagCorners& tag) { return directionsOf(scene.camera->model, tag, faults); });
  }
  faults.throwIfAny();
  return withNearPressures(readings.take(), scene.arm);
}

LoadedCaptures makeCaptures(const io::Scene& scene, std::vector<io::TagPoseCapture> seen,
                            const std::string& name) {
  requirePressures(name, scene.arm);
  for (io::TagPoseCapture& capture : seen) {
    for (io::TagPose& one : capture.tags) one.X_BT = scene.X_BF * one.X_BT;
  }
  return withNearPressures(posesOf(scene, seen, name), scene.arm);
}

estimation::ArmCaptures makeArmCaptures(const io::Scene& scene,
                                        std::vector<estimation::Capture> captures) {
  estimation::ArmCaptures arm{scene.name, scene.arm, scene.vision.fit.planar, {}, {}, {}, {}};
  arm.load = scene.model.load();
  arm.tier = scene.model.choice().setting;
  if (scene.tags) arm.layout = *scene.tags;
  if (scene.camera) {
    arm.X_CB = scene.X_CB();
    arm.camera = scene.camera->model;
  }
  arm.captures = std::move(captures);
  return arm;
}

const estimation::TwistFit& fitTags(const io::Scene& scene, const estimation::Reading& reading,
                                    const model::Shape& start, estimation::TwistFitter& fitter) {
  if (const auto* poses = std::get_if<PosesOfTags>(&reading)) return fitter.fitCold(*poses, start);
  return fitter.fitCold(std::get<CornersOfTags>(reading), scene.X_CB(), scene.camera->model.focal(),
                        start);
}

std::vector<FittedShape> fitShapes(const io::Scene& scene,
                                   const std::vector<estimation::Capture>& captures) {
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  std::vector<FittedShape> out;
  std::vector<std::optional<estimation::CaptureScatter>> scatter(captures.size());
  for (const estimation::Capture& capture : captures) {
    const Eigen::VectorXd pressure = scene.arm.clamped(capture.pressure);
    const statics::Solution model = modelUnder(scene, capture.payload).solve(pressure);
    out.push_back({model, std::nullopt});
    const bool poses = std::holds_alternative<PosesOfTags>(capture.reading);
    const bool corners = std::holds_alternative<CornersOfTags>(capture.reading) && scene.camera;
    if (!poses && !corners) continue;
    const estimation::TwistFit& fit = fitTags(
        scene, capture.reading, statics::startingShape(scene.model, model, pressure), fitter);
    out.back().fit = fit;
    if (!poses || fit.status != estimation::FitStatus::kConverged) continue;
    scatter[out.size() - 1] = estimation::scatterOf(fit, 3, scene.vision.fit.planar);
  }
  const estimation::CaptureCheck check = estimation::checkCaptures(scatter);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (check.apart[i]) out[i].usual_rms = check.usual;
  }
  return out;
}

std::string scatterText(double rms, double usual) {
  return basics::format(
      "no shape explains it: the tags that fit best are off by RMS %.1f mm, usual in this "
      "data set are %.1f mm; look for swapped or moved tags, or leave the capture out",
      1e3 * rms, 1e3 * usual);
}

std::vector<std::string> warningsOfScatter(const io::Scene& scene,
                                           const std::vector<estimation::Capture>& captures) {
  const bool poses =
      !captures.empty() && std::holds_alternative<PosesOfTags>(captures.front().reading);
  if (!scene.tags || !poses) return {};
  const std::vector<FittedShape> shapes = fitShapes(scene, captures);
  std::vector<int> apart;
  double largest = 0, usual = 0;
  for (std::size_t i = 0; i < captures.size(); ++i) {
    if (!shapes[i].usual_rms) continue;
    apart.push_back(captures[i].number);
    largest = std::max(largest, shapes[i].fit->rms);
    usual = *shapes[i].usual_rms;
  }
  if (apart.empty()) return {};
  return {(apart.size() > 1 ? "captures " : "capture ") + io::listOf(apart) +
          (apart.size() > 1 ? "; the worst of them: " : ": ") + scatterText(largest, usual)};
}

void addCaptures(std::vector<estimation::Capture> captures, const std::string& file,
                 CalibrationData& data) {
  std::set<int> taken;
  for (const estimation::Capture& one : data.captures) taken.insert(one.number);
  const bool meet = std::any_of(captures.begin(), captures.end(),
                                [&taken](const auto& one) { return taken.count(one.number) > 0; });
  if (meet) {
    const int offset = *taken.rbegin();
    for (estimation::Capture& one : captures) one.number += offset;
    data.warnings.push_back("captures of " + file + " are renumbered: their number + " +
                            std::to_string(offset));
  }
  std::move(captures.begin(), captures.end(), std::back_inserter(data.captures));
}

void addDataSet(const io::Scene& scene, const io::DataSet& set, CalibrationData& data) {
  int count = static_cast<int>(set.values.rows());
  const DataKind kind = kindOf(set);
  if (kind != DataKind::kLengths) {
    const std::string missing = io::missingText(set, scene.arm.actuatorCount());
    if (!missing.empty()) data.warnings.push_back(missing);
  }
  switch (kind) {
    case DataKind::kLengths:
      if (set.find("force_n") >= 0) {
        refuse(set.path,
               "holds forces of a testing machine; give --muscles, the number of muscles "
               "in parallel on it");
      }
      append(lengthSeriesOf(set), set.path, data.lengths);
      break;
    case DataKind::kTipSeries:
      append(tipSeriesOf(set, scene.arm.actuatorCount()), set.path, data.tips);
      break;
    case DataKind::kCurvatures:
    case DataKind::kTagPoses:
    case DataKind::kTagCorners: {
      LoadedCaptures read = loadCaptures(scene, set, OutsideLimits::kKept);
      count = static_cast<int>(read.captures.size());
      if (!read.unknown_ids.empty()) {
        data.warnings.push_back(
            set.path + " has tags that are not in the scene: " + io::listOf(read.unknown_ids));
      }
      addCaptures(std::move(read.captures), set.path, data);
      break;
    }
  }
  data.sources.push_back({set.path, set.sha256, count});
}

CalibrationData loadCalibrationData(const io::Scene& scene, const std::vector<std::string>& paths,
                                    const RecordedPressures& pressures) {
  CalibrationData out;
  for (const std::string& path : paths) {
    addDataSet(scene, measurementsOf(scene, path, pressures, out.warnings), out);
  }
  return out;
}

std::optional<std::string> repeatedSource(const std::vector<io::Provenance::Data>& sources) {
  std::map<std::string, std::string> files;
  for (const io::Provenance::Data& source : sources) {
    const auto [known, is_new] = files.emplace(source.sha256, source.file);
    if (!is_new) {
      return source.file + " has the same content as " + known->second +
             "; give each data set once";
    }
  }
  return std::nullopt;
}

}  // namespace helix_arm::procedures
