#include <algorithm>
#include <array>
#include <limits>
#include <tuple>
#include <variant>

#include <opencv2/core.hpp>
#include <pybind11/stl.h>

#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "io/document/atomic_file.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/captures.hpp"
#include "procedures/contact_proof.hpp"
#include "procedures/follow_run.hpp"
#include "procedures/response_series.hpp"

namespace helix_arm::python {
namespace {

using procedures::FollowRow;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// A data set: a file, or its name, the names of its columns, their numbers (rows, columns), and the
// names of its trials if it has them.
using Names = std::vector<std::string>;
using Data = std::variant<std::string, std::tuple<std::string, Names, py::array, Names>>;

// @throws DocumentError with the faults of a file.
io::DataSet dataSetOf(const Data& given) {
  if (const auto* path = std::get_if<std::string>(&given)) return io::loadDataSet(*path);
  const auto& [name, columns, values, trials] = std::get<1>(given);
  const Rows rows(values, name.c_str(), static_cast<py::ssize_t>(columns.size()));
  io::DataSet out;
  out.path = name;
  out.columns = columns;
  out.trials = trials;
  io::refuseMisspelled(out);
  out.values.resize(rows.rows(), rows.columns());
  for (int row = 0; row < out.values.rows(); ++row) {
    out.values.row(row) = rows.row(row);
    out.lines.push_back(row + 1);
  }
  std::string bytes;
  for (const std::string& column : out.columns) bytes += column + ",";
  bytes.append(reinterpret_cast<const char*>(out.values.data()),
               static_cast<std::size_t>(out.values.size()) * sizeof(double));
  out.sha256 = io::sha256Of(bytes);
  return out;
}

// Warns of pressures that count as 0 since there is no column.
void warnOfMissing(const io::DataSet& data, const io::Scene& scene) {
  const std::string warning = io::missingText(data, scene.arm.actuatorCount());
  if (!warning.empty() && PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 1) != 0) {
    throw py::error_already_set();
  }
}

// A fitted shape, and the ids of the tags that do not fit, ascending. NaN without a fit.
py::dict shapeOf(const io::Scene& scene, const estimation::TwistFit* fit) {
  const int size = 6 * scene.arm.sectionCount();
  Eigen::VectorXd twists = Eigen::VectorXd::Constant(size, kNaN);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Constant(size, size, kNaN);
  Eigen::Vector3d tip;
  Eigen::Vector4d quaternion;
  Eigen::Matrix3d tip_covariance = Eigen::Matrix3d::Constant(kNaN);
  setPose(fit ? fit->X_B0B * model::tipPose(fit->shape) : lie::SE3(), fit != nullptr, tip.data(),
          quaternion.data());
  std::vector<int> outliers;
  if (fit != nullptr) {
    twists = fit->twists.reshaped();
    covariance = fit->covariance;
    tip_covariance = fit->tip_covariance;
    for (const estimation::TagResidual& tag : fit->tags) {
      if (tag.outlier) outliers.push_back(scene.tags->tags[static_cast<std::size_t>(tag.tag)].id);
    }
    std::sort(outliers.begin(), outliers.end());
  }
  return py::dict("twists"_a = arrayOf(twists.reshaped(6, size / 6).transpose()),
                  "covariance"_a = arrayOf(covariance), "tip"_a = arrayOf(tip),
                  "quaternion_xyzw"_a = arrayOf(quaternion),
                  "tip_covariance"_a = arrayOf(tip_covariance), "rms"_a = fit ? fit->rms : kNaN,
                  "outlier_tags"_a = outliers);
}

// @return number, pressures and shape of each capture.
py::list fit(const Scene& self, const Data& data) {
  const io::Scene& scene = self.scene();
  basics::require(scene.tags.has_value(), "fit() needs tags, but scene ", scene.name,
                  " has none; expected a scene with a section tags");
  const io::DataSet set = dataSetOf(data);
  warnOfMissing(set, scene);
  // Pressures outside the limits count as at them: they are but where the fit begins.
  std::vector<estimation::Capture> measured =
      procedures::loadCaptures(scene, set, procedures::OutsideLimits::kKept).captures;
  basics::require(
      measured.empty() ||
          !std::holds_alternative<estimation::CurvatureReading>(measured.front().reading),
      "captures holds curvatures, which give no shape; expected tag poses or tag corners");

  py::list out;
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  for (estimation::Capture& capture : measured) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    capture.pressure = scene.arm.clamped(capture.pressure);
    const estimation::TwistFit* found = nullptr;
    {
      const OthersRun others_run;
      const model::Shape start = statics::startingShape(
          scene.model, scene.model.solve(capture.pressure), capture.pressure);
      found = &procedures::fitTags(scene, capture.reading, start, fitter);
    }
    const bool fitted = found->status == estimation::FitStatus::kConverged ||
                        found->status == estimation::FitStatus::kNotConverged;
    py::dict one = shapeOf(scene, fitted ? found : nullptr);
    one["capture"] = capture.number;
    one["pressures_pa"] = arrayOf(capture.pressure);
    one["status"] = estimation::nameOf(found->status);
    out.append(one);
  }
  return out;
}

// Errors of the model, one per row with a curvature or a position, or per capture of tags: of a
// curvature [rad], else of the tip [m]. @return the kind of data, its unit and the errors.
py::tuple evaluate(const Scene& self, const Data& data) {
  const io::Scene& scene = self.scene();
  const io::DataSet set = dataSetOf(data);
  warnOfMissing(set, scene);
  const int actuators = scene.arm.actuatorCount();
  switch (procedures::kindOf(set)) {
    case procedures::DataKind::kLengths:
      break;
    case procedures::DataKind::kTipSeries: {
      Eigen::VectorXd errors;
      {
        const OthersRun others_run;
        const auto tips = procedures::ofArm(procedures::tipSeriesOf(set, actuators));
        errors =
            estimation::compareSeries(procedures::priorOf(scene), tips).deviation.rowwise().norm();
      }
      return py::make_tuple("series", "m", arrayOf(errors));
    }
    case procedures::DataKind::kCurvatures: {
      basics::require(scene.arm.sectionCount() == 1,
                      "curvature_rad applies to arms of one section");
      const Eigen::MatrixXd pressures = procedures::pressuresWithinLimits(set, scene.arm);
      Eigen::VectorXd errors = -set.values.col(set.find("curvature_rad"));
      for (Eigen::Index row = 0; row < errors.size(); ++row) {
        const statics::Solution found = scene.model.solve(pressures.row(row));
        errors[row] += found.converged() ? model::curvatureOf(found.shape.twists().col(0)) : kNaN;
      }
      return py::make_tuple("curvatures", "rad", arrayOf(errors));
    }
    case procedures::DataKind::kTagPoses:
    case procedures::DataKind::kTagCorners: {
      std::vector<double> errors;
      {
        const OthersRun others_run;
        errors = procedures::tipErrors(scene, procedures::loadCaptures(scene, set).captures);
      }
      return py::make_tuple(
          "tags", "m",
          arrayOf(Eigen::VectorXd::Map(errors.data(), static_cast<Eigen::Index>(errors.size()))));
    }
  }
  throw py::value_error(
      "data holds free lengths, which no shape has; expected curvatures, tag "
      "poses, tag corners or a series of the tip");
}

// @param pictures  (N, height, width) of the scene's camera.
py::list localize(const Scene& self, const py::array_t<std::uint8_t, py::array::c_style>& pictures,
                  const py::object& pressures) {
  const io::Scene& scene = self.scene();
  const py::ssize_t count = pictures.shape(0);
  const Rows inputs = self.inputs(pressures, "pressures_pa");
  basics::require(inputs.single() || inputs.rows() == count, "pressures_pa has ", inputs.rows(),
                  " rows; expected one per picture: ", count);
  vision::ArmLocalizer localizer(scene.view(), scene.vision);
  Eigen::VectorXd q;
  py::list out;
  for (py::ssize_t i = 0; i < count; ++i) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const cv::Mat picture(static_cast<int>(pictures.shape(1)), static_cast<int>(pictures.shape(2)),
                          CV_8UC1, const_cast<std::uint8_t*>(pictures.data(i)));
    self.copyRow(inputs, inputs.single() ? 0 : i, &q);
    const vision::Observation* seen = nullptr;
    {
      const OthersRun others_run;
      seen =
          &localizer.locate(picture, statics::startingShape(scene.model, scene.model.solve(q), q));
    }
    const auto tags = static_cast<Eigen::Index>(seen->detections.size());
    Eigen::VectorXi ids(tags);
    Eigen::MatrixXd corners(tags, 8);
    for (Eigen::Index k = 0; k < tags; ++k) {
      const vision::TagDetection& tag = seen->detections[static_cast<std::size_t>(k)];
      ids[k] = tag.id;
      corners.row(k) = tag.corners.reshaped();
    }
    const bool measured = seen->state == vision::ObservationState::kMeasured;
    py::dict one = shapeOf(scene, measured ? &seen->fit : nullptr);
    one["state"] = vision::nameOf(seen->state);
    one["tags"] = arrayOf(ids);
    one["corners_px"] = arrayOf(corners);
    one["unknown_tags"] = seen->unknown_ids;
    one["repeated_tags"] = seen->repeated_ids;
    out.append(one);
  }
  return out;
}

py::dict dictOf(const estimation::Parameter& one) {
  const bool judged = procedures::isJudged(one);
  return py::dict("name"_a = one.name, "unit"_a = one.unit, "initial"_a = one.initial,
                  "value"_a = one.value,
                  "standard_error"_a = judged ? std::optional(one.standard_error) : std::nullopt,
                  "identifiable"_a = judged ? std::optional(one.identifiable) : std::nullopt);
}

py::dict dictOf(const estimation::Combination& one) {
  py::dict exponents;
  for (const auto& power : one.powers) exponents[py::str(power.parameter)] = power.exponent;
  return py::dict("name"_a = one.name, "exponents"_a = exponents, "value"_a = one.value,
                  "relative_error"_a = one.relative_error, "identifiable"_a = one.identifiable);
}

py::dict dictOf(const std::pair<std::string, estimation::ContractionFit>& named) {
  const auto& [name, curve] = named;
  return py::dict("name"_a = name, "is_quintic"_a = curve.kind == estimation::CurveKind::kQuintic,
                  "coefficients_m"_a = curve.coefficients,
                  "reference_pressure_pa"_a = curve.reference_pressure,
                  "pressures_pa"_a = curve.pressures, "lengths_m"_a = curve.lengths,
                  "rms_m"_a = curve.rms, "constrained"_a = curve.constrained,
                  "hysteresis_m"_a = curve.hysteresis, "found"_a = curve.curve.has_value());
}

py::dict dictOf(const estimation::Suspect& one) {
  return py::dict("cause"_a = one.cause, "where"_a = one.where, "explains"_a = one.explains,
                  "remedy"_a = one.remedy);
}

py::dict dictOf(const procedures::FollowAlarm& alarm) {
  return py::dict("time_s"_a = alarm.time, "onset_s"_a = alarm.onset,
                  "force_n"_a = arrayOf(alarm.force), "covariance"_a = arrayOf(alarm.covariance),
                  "normalised"_a = alarm.normalised);
}

template <class Values>
py::list dictsOf(const Values& values) {
  return listOf(values, [](const auto& one) { return dictOf(one); });
}

// @param noises  of curvatures [rad], corners [px], positions [m] and rotations [rad], 0: the
//     scene's; of the rest of a series from trial to trial [m].
// @param curve  quintic or table; empty: the default. @param branch  both, rising or falling.
procedures::CalibrationRequest requestOf(const std::vector<std::string>& words,
                                         const std::string& contraction,
                                         const std::array<double, 5>& noises, bool errors,
                                         const std::string& curve, const std::string& branch) {
  procedures::CalibrationRequest request;
  request.fit = words;
  request.contraction = contraction;
  request.curvature_noise = noises[0];
  request.corner_noise = noises[1];
  request.position_noise = noises[2];
  request.rotation_noise = noises[3];
  request.rest_offset = noises[4];
  request.errors = errors;
  if (!curve.empty()) {
    request.curve =
        curve == "table" ? estimation::CurveKind::kTable : estimation::CurveKind::kQuintic;
  }
  if (branch == "rising") request.branch = estimation::Branch::kRising;
  if (branch == "falling") request.branch = estimation::Branch::kFalling;
  return request;
}

py::dict calibrate(const Scene& self,
                   const std::variant<procedures::CalibrationData, std::vector<Data>>& data,
                   const std::vector<std::string>& words, const std::string& contraction,
                   const std::array<double, 5>& noises, bool errors, const std::string& curve,
                   const std::string& branch, bool force, int apply_suspect) {
  procedures::CalibrationRequest request =
      requestOf(words, contraction, noises, errors, curve, branch);
  request.force = force;
  request.apply_suspect = apply_suspect;
  procedures::CalibrationData read;
  if (const auto* sets = std::get_if<std::vector<Data>>(&data)) {
    for (const Data& one : *sets) procedures::addDataSet(self.scene(), dataSetOf(one), read);
    const auto repeated = procedures::repeatedSource(read.sources);
    basics::require(!repeated, repeated.value_or(""));
  }
  const auto* recorded = std::get_if<procedures::CalibrationData>(&data);
  procedures::CalibrationOutcome outcome;
  {
    const OthersRun others_run;
    outcome = procedures::runCalibration(self.path(), self.overrides(), request,
                                         recorded ? *recorded : read);
  }
  py::dict out("success"_a = outcome.success, "message"_a = outcome.message,
               "parameters"_a = dictsOf(procedures::parametersOf(outcome)),
               "correlation"_a = py::none(), "combinations"_a = py::list(), "error_unit"_a = "",
               "rms"_a = py::none(), "held_out_error"_a = py::none(),
               "next_pressures_pa"_a = py::none(), "contractions"_a = dictsOf(outcome.contractions),
               "tip_error_before_m"_a = outcome.tip_error_before,
               "tip_error_after_m"_a = outcome.tip_error_after,
               "suspects"_a = dictsOf(outcome.suspects), "warnings"_a = outcome.warnings,
               "scene_text"_a = outcome.scene_text, "response_rms_m"_a = py::none());
  if (outcome.response) out["response_rms_m"] = outcome.response->fit.rms;
  if (outcome.series) {
    std::vector<std::string> warnings = outcome.warnings;
    warnings.insert(warnings.end(), outcome.series->rules.begin(), outcome.series->rules.end());
    out["warnings"] = warnings;
    out["error_unit"] = "m";
    out["rms"] = outcome.series->rms;
    out["held_out_error"] = outcome.series->held_out_rms;
  }
  if (!outcome.calibration) return out;
  const estimation::Calibration& found = *outcome.calibration;
  out["error_unit"] = found.error_unit;
  out["rms"] = found.rms;
  if (found.correlation.size() == 0) return out;  // without errors
  out["correlation"] = arrayOf(found.correlation);
  out["combinations"] = dictsOf(found.combinations);
  if (found.by_pressure) out["held_out_error"] = found.by_pressure->error;
  out["next_pressures_pa"] =
      listOf(found.next_pressures, [](const Eigen::VectorXd& each) { return arrayOf(each); });
  return out;
}

// One row of numbers for each of the run; NaN where there is none.
Eigen::MatrixXd numbersOf(const std::vector<FollowRow>& rows, int actuators) {
  const auto or_nan = [](const std::optional<Eigen::Vector3d>& position) {
    return Eigen::RowVector3d(position.value_or(Eigen::Vector3d::Constant(kNaN)));
  };
  Eigen::MatrixXd out(static_cast<Eigen::Index>(rows.size()), 16 + actuators);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const FollowRow& row = rows[i];
    out.row(static_cast<Eigen::Index>(i)) << row.time, or_nan(row.wanted), row.true_tip.transpose(),
        or_nan(row.measured), row.measured ? row.measured_time : kNaN, or_nan(row.predicted),
        row.path_time.value_or(kNaN), row.load_score, row.pressure.transpose();
  }
  return out;
}

// None without one; covariances (3, 3) [m^2] by their names.
py::object budgetOf(const std::optional<estimation::TipErrorBudget>& budget) {
  if (!budget) return py::none();
  py::dict spreads;
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const auto part = static_cast<estimation::BudgetPart>(i);
    spreads[nameOf(part)] = arrayOf(budget->part(part).covariance);
  }
  spreads["predicted"] = arrayOf(budget->predicted.covariance);
  spreads["open_loop"] = arrayOf(budget->open_loop.covariance);
  return py::dict("time_s"_a = budget->time, "covariances_m2"_a = spreads,
                  "error_m"_a = arrayOf(budget->error), "distance2"_a = budget->distance2,
                  "limit"_a = budget->limit, "state"_a = nameOf(budget->state));
}

// @param path   (N, 4) times [s] and positions [m].
// @param force  its time [s], then the force [N].
// @return the numbers of all rows, as of numbersOf(); states and reach of these; other fields.
py::tuple follow(const Scene& self, const py::object& tips, const py::object& path,
                 std::optional<double> seconds, bool open, bool rendered,
                 const std::optional<std::array<double, 4>>& force,
                 const std::optional<std::array<double, 2>>& blind, double latency,
                 std::uint32_t seed, const Scene& rig, const std::string& plant) {
  procedures::FollowPlan plan;
  plan.plant = plant;
  plan.seconds = seconds.value_or(plan.seconds);
  plan.open = open;
  if (rendered) plan.vision = simulation::VisionKind::kRendered;
  plan.latency = latency;
  plan.seed = seed;
  if (!tips.is_none()) {
    const Rows rows(tips, "tips", 3);
    for (py::ssize_t i = 0; i < rows.rows(); ++i) plan.tips.emplace_back(rows.row(i));
  }
  if (!path.is_none()) {
    const Rows rows(path, "path", 4);
    std::vector<control::TipWayPoint> points;
    for (py::ssize_t i = 0; i < rows.rows(); ++i) {
      points.push_back({rows(i, 0), rows.row(i).tail<3>()});
    }
    plan.path.emplace(points);
    const auto refusal = procedures::checkPath(self.scene(), *plan.path);
    basics::require(!refusal, "path: ", refusal ? refusal->reason : "");
    if (!seconds) procedures::endWithPath(plan);
  }
  if (force) {
    const auto& [time, x, y, z] = *force;
    plan.force = procedures::TimedForce{time, {x, y, z}};
  }
  if (blind) plan.blind = model::Range{(*blind)[0], (*blind)[1]};
  bool interrupted = false;
  procedures::FollowResult result;
  {
    OthersRun others_run;
    const auto progress = [&](double) { return !(interrupted = others_run.interrupted()); };
    result = procedures::runFollow(self.scene(), rig.scene(), plan, progress);
  }
  if (interrupted) throw py::error_already_set();
  const auto states = listOf(result.rows, [](const FollowRow& row) { return nameOf(row.state); });
  const auto unreachable =
      listOf(result.rows, [](const FollowRow& row) { return row.unreachable; });
  const procedures::FollowFigures& figures = result.figures;
  return py::make_tuple(
      arrayOf(numbersOf(result.rows, self.arm().actuatorCount())), states, unreachable,
      dictsOf(result.alarms),
      py::dict("path_rms_m"_a = figures.path_rms, "path_max_m"_a = figures.path_max,
               "last_turn_rms_m"_a = figures.last_turn_rms, "steady_rms_m"_a = figures.steady_rms,
               "settle_s"_a = figures.settle, "pictures"_a = result.pictures,
               "vented"_a = result.vented, "reason"_a = failureOf(plan, result),
               "budget"_a = budgetOf(result.budget), "suspects"_a = dictsOf(result.suspects)));
}

// @return rows of a time [s], a position [m] and a velocity [m/s].
py::array quietPath(const Scene& self, double seconds, std::uint32_t seed) {
  const control::TipPath path = procedures::quietPath(self.scene(), seconds, seed);
  Eigen::MatrixXd out(static_cast<Eigen::Index>(path.segmentCount()) + 1, 7);
  for (Eigen::Index i = 0; i < out.rows(); ++i) {
    const auto segment = static_cast<std::size_t>(i);
    const double time =
        segment < path.segmentCount() ? path.segment(segment).begin : path.lastTime();
    const control::TipReference place = path.at(time);
    out.row(i) << time, place.position.transpose(), place.velocity.transpose();
  }
  return arrayOf(out);
}

py::dict contactProof(const Scene& self, double highest, double seconds, double unit_force) {
  const auto proof = procedures::contactProof(self.scene(), {highest, seconds, unit_force});
  return py::dict(
      "contact_limit"_a = proof.limit, "on_contact"_a = nameOf(proof.on_contact),
      "doubt"_a = proof.doubt, "found_force"_a = proof.force, "normalised"_a = proof.normalised,
      "scene_text"_a = procedures::provenSceneText(self.path(), self.overrides(), proof));
}

}  // namespace

void bindMeasurements(py::class_<Scene>& scene) {
  scene.def("_fit", fit, "captures"_a)
      .def("_evaluate", evaluate, "data"_a)
      .def("_localize", localize, "pictures"_a, "pressures_pa"_a)
      .def("_calibrate", calibrate, "data"_a, "fit"_a, "contraction"_a, "noises"_a, "errors"_a,
           "curve"_a = "", "branch"_a = "both", "force"_a = false, "apply_suspect"_a = 0)
      .def("_follow", follow, "tips"_a, "path"_a, "seconds"_a, "open"_a, "rendered"_a, "force"_a,
           "blind"_a, "latency_s"_a, "seed"_a, "rig"_a, "plant"_a)
      .def("_quiet_path", quietPath, "seconds"_a, "seed"_a)
      .def("_contact_proof", contactProof, "highest_score"_a, "seconds"_a, "unit_force"_a);
}

}  // namespace helix_arm::python
