#include <cmath>

#include <pybind11/stl.h>

#include "bindings.hpp"
#include "data.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "parallel.hpp"

namespace helix_arm::python {
namespace {

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

void bindCalibrate(py::class_<Scene>& scene) {
  scene.def("_calibrate", calibrate, py::arg("data"), py::arg("fit"), py::arg("contraction"),
            py::arg("curvature_noise_rad"), py::arg("corner_noise_px"), py::arg("position_noise_m"),
            py::arg("rotation_noise_rad"), py::arg("errors"));
}

}  // namespace helix_arm::python
