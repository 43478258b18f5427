#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <sstream>
#include <variant>

#include <opencv2/core.hpp>
#include <pybind11/stl.h>

#include "arrays.hpp"
#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/vision/arm_localizer.hpp"

namespace helix_arm::python {

namespace {

constexpr py::ssize_t kMostRows = 200'000;  // as of a file
constexpr py::ssize_t kMostColumns = 1000;

io::DataSet tableOf(const py::dict& columns, const std::string& name) {
  basics::require(!columns.empty() && static_cast<py::ssize_t>(columns.size()) <= kMostColumns,
                  name, " has ", columns.size(), " columns; expected 1 to ", kMostColumns);
  io::DataSet out;
  out.path = name;
  for (const auto& [key, value] : columns) {
    const std::string column = textOf(key, ("a name of a column of " + name).c_str());
    const std::string where = name + "[\"" + column.substr(0, 60) + "\"]";
    const py::array array = arrayOf(value, where.c_str());
    const bool fits = array.ndim() == 1 && array.size() > 0 && array.size() <= kMostRows &&
                      (out.columns.empty() || array.size() == out.values.rows());
    basics::require(fits, where, " has shape ", shapeText(array), "; expected 1 to ", kMostRows,
                    " numbers, as many as the other columns");
    if (out.columns.empty()) out.values.resize(array.size(), static_cast<int>(columns.size()));
    const Rows numbers(array, where.c_str(), array.size());
    requireFinite(numbers);
    out.values.col(static_cast<int>(out.columns.size())) = numbers.row(0);
    out.columns.push_back(column);
  }
  for (int row = 0; row < out.values.rows(); ++row) out.lines.push_back(row + 1);
  std::string bytes;
  for (const std::string& column : out.columns) bytes += column + ",";
  bytes.append(reinterpret_cast<const char*>(out.values.data()),
               static_cast<std::size_t>(out.values.size()) * sizeof(double));
  out.sha256 = io::sha256Of(bytes);
  return out;
}

// A data set of an argument: a file, or a dict of columns (arrays of equal length), in the units of
// their names as in a file.
// @throws DocumentError with the faults of a file; TypeError or ValueError naming the argument.
io::DataSet dataSetOf(const py::handle& given, const std::string& name) {
  if (py::isinstance<py::str>(given)) return io::loadDataSet(textOf(given, name.c_str()));
  if (py::isinstance<py::dict>(given)) {
    return tableOf(py::reinterpret_borrow<py::dict>(given), name);
  }
  refuseType(given, name.c_str(), "the path of a data set, or a dict of its columns");
}

// Fitted shapes, one per row; rows that are not set hold NaN.
struct FitArrays {
  FitArrays(int section_count, py::ssize_t count)
      : sections(section_count),
        twists(Shape{count, sections, 6}),
        covariances(Shape{count, 6 * sections, 6 * sections}),
        tips(Shape{count, 3}),
        quaternions(Shape{count, 4}),
        tip_covariances(Shape{count, 3, 3}),
        rms(count) {
    for (auto* array : {&twists, &covariances, &tips, &quaternions, &tip_covariances, &rms}) {
      std::fill_n(array->mutable_data(), array->size(), std::numeric_limits<double>::quiet_NaN());
    }
  }
  void set(std::size_t row, const estimation::TwistFit& fit) {
    const int size = 6 * sections;
    std::copy_n(fit.twists.data(), size, twists.mutable_data() + row * size);
    Eigen::MatrixXd::Map(covariances.mutable_data() + row * size * size, size, size) =
        fit.covariance;  // symmetric
    Eigen::Matrix3d::Map(tip_covariances.mutable_data() + 9 * row) = fit.tip_covariance;
    setPose(fit.X_B0B * model::tipPose(fit.shape), true, tips.mutable_data() + 3 * row,
            quaternions.mutable_data() + 4 * row);
    rms.mutable_at(static_cast<py::ssize_t>(row)) = fit.rms;
  }

  using Shape = std::vector<py::ssize_t>;
  int sections;
  py::array_t<double> twists, covariances, tips, quaternions, tip_covariances, rms;
};

// Ids of the tags that do not fit, ascending.
py::list outliersOf(const estimation::TwistFit& fit, const estimation::TagLayout& layout) {
  std::vector<int> ids;
  for (const estimation::TagResidual& tag : fit.tags) {
    if (tag.outlier) ids.push_back(layout.tags[static_cast<std::size_t>(tag.tag)].id);
  }
  std::sort(ids.begin(), ids.end());
  return py::cast(ids);
}

// Pressures of tag poses outside the limits count as at them: they are but a start.
std::vector<estimation::Capture> capturesOf(const io::Scene& scene, const io::DataSet& data) {
  if (procedures::kindOf(data) != procedures::DataKind::kTagPoses) {
    return procedures::loadCaptures(scene, data).captures;
  }
  std::vector<estimation::Capture> out;
  for (const io::TagPoseCapture& capture :
       io::loadTagPoses(data, scene.arm.actuatorCount(), scene.X_BF)) {
    std::vector<estimation::PoseObservation> seen;
    for (const io::TagPose& tag : capture.tags) {
      const int index = scene.tags->find(tag.id);
      if (index >= 0) seen.push_back({index, tag.X_BT});
    }
    out.push_back({capture.number, scene.arm.clamped(capture.pressure), std::move(seen)});
  }
  return out;
}

py::dict fit(const Scene& self, const py::object& captures) {
  const io::Scene& scene = self.scene();
  basics::require(scene.tags.has_value(), "fit() needs tags, but scene ", scene.name,
                  " has none; expected a scene with a section tags");
  const std::vector<estimation::Capture> measured =
      capturesOf(scene, dataSetOf(captures, "captures"));
  basics::require(
      measured.empty() ||
          !std::holds_alternative<estimation::CurvatureReading>(measured.front().reading),
      "captures holds curvatures, which give no shape; expected tag poses or tag corners");

  FitArrays arrays(scene.arm.sectionCount(), static_cast<py::ssize_t>(measured.size()));
  std::vector<int> numbers;
  std::vector<std::string> status;
  Eigen::MatrixXd pressures(static_cast<Eigen::Index>(measured.size()), scene.arm.actuatorCount());
  py::list outliers;
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const estimation::Capture& capture = measured[i];
    numbers.push_back(capture.number);
    pressures.row(static_cast<Eigen::Index>(i)) = capture.pressure;
    const estimation::TwistFit* found = nullptr;
    {
      const OthersRun others_run;
      const model::Shape start = statics::startingShape(
          scene.model, scene.model.solve(capture.pressure), capture.pressure);
      if (const auto* poses =
              std::get_if<std::vector<estimation::PoseObservation>>(&capture.reading)) {
        found = &fitter.fitCold(*poses, start);
      } else {
        const auto& corners = std::get<std::vector<estimation::CornerObservation>>(capture.reading);
        found = &fitter.fitCold(corners, scene.X_CB(), scene.camera->model.focal(), start);
      }
    }
    status.emplace_back(estimation::nameOf(found->status));
    const bool fitted = found->status == estimation::FitStatus::kConverged ||
                        found->status == estimation::FitStatus::kNotConverged;
    if (fitted) arrays.set(i, *found);
    outliers.append(fitted ? outliersOf(*found, *scene.tags) : py::list());
  }
  py::dict out;
  out["captures"] = copyOf(numbers.data(), {static_cast<py::ssize_t>(numbers.size())});
  out["pressures_pa"] = matrixOf(pressures);
  out["status"] = textsOf(py::cast(status));
  out["twists"] = arrays.twists;
  out["covariances"] = arrays.covariances;
  out["tips"] = arrays.tips;
  out["quaternions_xyzw"] = arrays.quaternions;
  out["tip_covariances"] = arrays.tip_covariances;
  out["rms"] = arrays.rms;
  out["outlier_tags"] = outliers;
  return out;
}

// Gray pictures of one size.
struct Pictures {
  Pictures(const py::handle& given, const estimation::Camera& camera) {
    const bool bytes =
        py::isinstance<py::array>(given) &&
        py::reinterpret_borrow<py::array>(given).dtype().is(py::dtype::of<std::uint8_t>());
    if (!bytes) {
      throw py::type_error(
          "image is no array of bytes; expected a gray picture of dtype uint8, as of "
          "image.mean(axis=2).astype(np.uint8)");
    }
    const auto any = py::reinterpret_borrow<py::array>(given);
    const py::ssize_t n = any.ndim();
    const bool fits =
        (n == 2 || n == 3) && any.shape(n - 2) == camera.height && any.shape(n - 1) == camera.width;
    if (!fits) {
      std::ostringstream message;
      message << "image has shape " << shapeText(any) << "; expected gray pictures of the scene's "
              << "camera: (" << camera.height << ", " << camera.width << ") or (N, "
              << camera.height << ", " << camera.width << ")";
      throw py::value_error(message.str());
    }
    single = n == 2;
    count = single ? 1 : any.shape(0);
    array = py::array_t<std::uint8_t, py::array::c_style>(any);
    height = camera.height;
    width = camera.width;
  }
  cv::Mat at(py::ssize_t i) const {
    auto* const first = const_cast<std::uint8_t*>(array.data()) + i * height * width;
    return cv::Mat(height, width, CV_8UC1, first);
  }

  py::array_t<std::uint8_t, py::array::c_style> array;
  bool single;
  py::ssize_t count;
  int height, width;
};

py::array cornersOf(const std::vector<vision::TagDetection>& tags) {
  py::array_t<double> out(std::vector<py::ssize_t>{static_cast<py::ssize_t>(tags.size()), 4, 2});
  double* to = out.mutable_data();
  for (const vision::TagDetection& tag : tags) {
    for (int k = 0; k < 4; ++k) {
      *to++ = tag.corners(0, k);
      *to++ = tag.corners(1, k);
    }
  }
  return out;
}

py::list localize(const Scene& self, const py::object& image, const py::object& pressures) {
  const io::Scene& scene = self.scene();
  basics::require(scene.camera && scene.tags, "localize() needs camera and tags, but scene ",
                  scene.name, " lacks one; expected a scene with sections camera and tags");
  const Pictures pictures(image, scene.camera->model);
  const py::object at = pressures.is_none() ? vectorOf(scene.arm.inputAt(0)) : pressures;
  const Rows inputs = self.inputs(at, "pressures_pa");
  basics::require(inputs.single() || inputs.rows() == pictures.count, "pressures_pa has ",
                  inputs.rows(), " rows; expected one per picture: ", pictures.count);
  self.requireWithinLimits(inputs);

  vision::ArmLocalizer localizer(scene.view(), scene.vision);
  Eigen::VectorXd q;
  py::list out;
  for (py::ssize_t i = 0; i < pictures.count; ++i) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const cv::Mat picture = pictures.at(i);
    self.copyRow(inputs, inputs.single() ? 0 : i, &q);
    const vision::Observation* observation = nullptr;
    {
      const OthersRun others_run;
      observation =
          &localizer.locate(picture, statics::startingShape(scene.model, scene.model.solve(q), q));
    }
    const bool measured = observation->state == vision::ObservationState::kMeasured;
    FitArrays arrays(scene.arm.sectionCount(), 1);
    if (measured) arrays.set(0, observation->fit);
    std::vector<int> ids;
    for (const vision::TagDetection& tag : observation->detections) ids.push_back(tag.id);
    const py::int_ first(0);
    py::dict one;
    one["state"] = vision::nameOf(observation->state);
    one["twists"] = arrays.twists[first];
    one["covariance"] = arrays.covariances[first];
    one["tip"] = arrays.tips[first];
    one["quaternion_xyzw"] = arrays.quaternions[first];
    one["tip_covariance"] = arrays.tip_covariances[first];
    one["rms_px"] = arrays.rms.at(0);
    one["tags"] = copyOf(ids.data(), {static_cast<py::ssize_t>(ids.size())});
    one["corners_px"] = cornersOf(observation->detections);
    one["outlier_tags"] = measured ? outliersOf(observation->fit, *scene.tags) : py::list();
    one["unknown_tags"] = observation->unknown_ids;
    one["repeated_tags"] = observation->repeated_ids;
    out.append(one);
  }
  return out;
}

py::list parameterList(const procedures::CalibrationOutcome& outcome) {
  py::list parameters;
  for (const estimation::Parameter& one : procedures::parametersOf(outcome)) {
    py::dict entry;
    entry["name"] = one.name;
    entry["unit"] = one.unit;
    entry["initial"] = one.initial;
    entry["value"] = one.value;
    const bool judged = procedures::isJudged(one);
    entry["standard_error"] = judged ? py::object(py::float_(one.standard_error)) : py::none();
    entry["identifiable"] = judged ? py::object(py::bool_(one.identifiable)) : py::none();
    parameters.append(entry);
  }
  return parameters;
}

py::list combinationsOf(const estimation::Calibration& calibration) {
  py::list combinations;
  for (const estimation::Combination& one : calibration.combinations) {
    py::dict exponents;
    for (const estimation::Combination::Power& power : one.powers) {
      exponents[py::str(power.parameter)] = power.exponent;
    }
    py::dict entry;
    entry["name"] = one.name;
    entry["exponents"] = exponents;
    entry["value"] = one.value;
    entry["relative_error"] = one.relative_error;
    entry["identifiable"] = one.identifiable;
    combinations.append(entry);
  }
  return combinations;
}

// Of the fit of the arm.
void addFit(const estimation::Calibration& calibration, py::dict& out) {
  out["error_unit"] = calibration.error_unit;
  out["rms"] = calibration.rms;
  if (calibration.correlation.size() == 0) return;  // without errors
  out["correlation"] = matrixOf(calibration.correlation);
  out["combinations"] = combinationsOf(calibration);
  if (calibration.by_pressure) out["held_out_error"] = calibration.by_pressure->error;
  Eigen::MatrixXd next(
      static_cast<Eigen::Index>(calibration.next_pressures.size()),
      calibration.next_pressures.empty() ? 0 : calibration.next_pressures.front().size());
  for (std::size_t i = 0; i < calibration.next_pressures.size(); ++i) {
    next.row(static_cast<Eigen::Index>(i)) = calibration.next_pressures[i];
  }
  out["next_pressures_pa"] = matrixOf(next);
}

double noiseOf(const py::object& given, const char* name) {
  const double noise = numberOf(given, name);
  basics::require(std::isfinite(noise) && noise >= 0, name, " is ", noise,
                  "; expected a finite number >= 0, 0 for the scene's");
  return noise;
}

py::dict calibrate(const Scene& self, const py::list& data, const py::list& fit,
                   const py::object& contraction, const py::object& curvature_noise_rad,
                   const py::object& corner_noise_px, const py::object& position_noise_m,
                   const py::object& rotation_noise_rad, const py::object& errors) {
  procedures::CalibrationRequest request;
  for (std::size_t i = 0; i < fit.size(); ++i) {
    request.fit.push_back(textOf(fit[i], ("fit[" + std::to_string(i) + "]").c_str()));
  }
  request.contraction = textOf(contraction, "contraction");
  request.curvature_noise = noiseOf(curvature_noise_rad, "curvature_noise_rad");
  request.corner_noise = noiseOf(corner_noise_px, "corner_noise_px");
  request.position_noise = noiseOf(position_noise_m, "position_noise_m");
  request.rotation_noise = noiseOf(rotation_noise_rad, "rotation_noise_rad");
  request.errors = flagOf(errors, "errors");
  request.date = procedures::utcNow();
  basics::require(!data.empty(), "data is empty; expected paths of data sets, or dicts of columns");
  procedures::CalibrationData measurements;
  for (std::size_t i = 0; i < data.size(); ++i) {
    procedures::addDataSet(self.scene(), dataSetOf(data[i], "data[" + std::to_string(i) + "]"),
                           measurements);
  }
  const auto repeated = procedures::repeatedSource(measurements.sources);
  basics::require(!repeated, repeated.value_or(""));
  procedures::CalibrationOutcome outcome;
  {
    const OthersRun others_run;
    outcome = procedures::runCalibration(self.path(), self.overrides(), request, measurements);
  }
  py::dict out;
  out["success"] = outcome.success;
  out["message"] = outcome.message;
  out["parameters"] = parameterList(outcome);
  out["correlation"] = py::none();
  out["combinations"] = py::list();
  out["error_unit"] = "";
  out["rms"] = py::none();
  out["held_out_error"] = py::none();
  out["next_pressures_pa"] = py::none();
  if (outcome.calibration) addFit(*outcome.calibration, out);
  py::list contractions;
  for (const auto& [name, curve] : outcome.contractions) {
    py::dict one;
    one["name"] = name;
    one["coefficients_m"] =
        std::vector<double>(curve.coefficients.begin(), curve.coefficients.end());
    one["reference_pressure_pa"] = curve.reference_pressure;
    one["rms_m"] = curve.rms;
    contractions.append(one);
  }
  out["contractions"] = contractions;
  out["tip_error_before_m"] = outcome.tip_error_before;
  out["tip_error_after_m"] = outcome.tip_error_after;
  out["warnings"] = outcome.warnings;
  out["scene_text"] = outcome.scene_text;
  return out;
}

}  // namespace

void bindFit(py::class_<Scene>& scene) { scene.def("_fit", fit, py::arg("captures")); }

void bindLocalize(py::class_<Scene>& scene) {
  scene.def("_localize", localize, py::arg("image"), py::arg("pressures_pa"));
}

void bindCalibrate(py::class_<Scene>& scene) {
  scene.def("_calibrate", calibrate, py::arg("data"), py::arg("fit"), py::arg("contraction"),
            py::arg("curvature_noise_rad"), py::arg("corner_noise_px"), py::arg("position_noise_m"),
            py::arg("rotation_noise_rad"), py::arg("errors"));
}

}  // namespace helix_arm::python
