#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include "bag/bag_captures.hpp"
#include "basics/text.hpp"
#include "bindings.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "io/document/atomic_file.hpp"
#include "procedures/captures.hpp"
#include "procedures/commissioning.hpp"
#include "procedures/pressure_plan.hpp"
#include "procedures/response_series.hpp"
#include "procedures/settle_watch.hpp"

namespace helix_arm::python {
namespace {

using procedures::CalibrationData;
using procedures::Sample;
using procedures::SeriesRecord;
using procedures::SettleRules;
using procedures::SettleWatch;
using procedures::Settling;

using Tag = std::pair<int, std::array<double, 8>>;  // its id and its corners [px]

const char* nameOfState(const Settling& settling) {
  static constexpr std::array<const char*, 6> kNames = {"settled",  "stale",  "unseen",
                                                        "pressure", "moving", "no_tags"};
  return kNames[static_cast<std::size_t>(settling.state)];
}

// @param tags  of a picture, all detections but those of an id that is seen twice.
void seePicture(SettleWatch& watch, const Scene& scene, double time, const std::vector<Tag>& tags) {
  std::vector<ros_bridge::SeenTag> detections;
  for (const auto& [id, corners] : tags) {
    procedures::TagObservation& tag = detections.emplace_back().observation;
    tag.id = id;
    std::copy(corners.begin(), corners.end(), tag.corners.data());
  }
  watch.seen(time, ros_bridge::observationsOf(detections, scene.scene()));
}

// @param bodies  names, and position and quaternion x, y, z, w of each [m].
void seeBodies(SettleWatch& watch, const Scene& scene, double time,
               const std::vector<std::pair<std::string, std::array<double, 7>>>& bodies) {
  std::vector<ros_bridge::SeenTag> detections;
  for (const auto& [name, pose] : bodies) {
    for (const estimation::TagPlacement& placed : scene.scene().tags->tags) {
      if (placed.name != name) continue;
      const Eigen::Quaterniond q(pose[6], pose[3], pose[4], pose[5]);
      const lie::SE3 X{q.normalized().toRotationMatrix(), {pose[0], pose[1], pose[2]}};
      detections.push_back({procedures::TagObservation::ofBody(placed.id, X), false});
    }
  }
  watch.seen(time, ros_bridge::observationsOf(detections, scene.scene()));
}

// A tip that is not finite or too far away does not count.
void seeTip(SeriesRecord& series, double time, const Eigen::Vector3d& tip) {
  const auto checked = control::checkPosition(tip);
  if (std::holds_alternative<Eigen::Vector3d>(checked)) series.seen(time, tip);
}

// Data for a calibration from recorded samples and of the series of a run, which may be None and is
// not recorded any more.
CalibrationData measuredOf(const Scene& self, const std::vector<Sample>& samples,
                           const SeriesRecord* record) {
  const OthersRun others_run;
  const io::Scene& scene = self.scene();
  const ros_bridge::SampleTable seen(samples, scene);
  CalibrationData out;
  out.captures = seen.captures(scene, "recorded samples").captures;
  out.sources.push_back(
      {"recorded samples", io::sha256Of(seen.csv(scene.arm.actuatorCount(), "")), seen.size()});
  if (record == nullptr) return out;
  out.tips = record->series();
  if (out.tips.empty()) return out;
  out.sources.push_back({"recorded series", io::sha256Of(procedures::tipSeriesCsv(out.tips, "")),
                         static_cast<int>(out.tips.history.rows())});
  if (record->leftOut() > 0) {
    out.warnings.push_back("the series of the tip has no room for its last " +
                           std::to_string(record->leftOut()) +
                           " rows; expected a run of fewer steps");
  }
  return out;
}

// @param corrects  also gives the scene without the leading mistake, where it can say that.
py::dict commissionOf(const Scene& self, const CalibrationData& data, bool corrects) {
  procedures::Commissioning found;
  procedures::Correction correction;
  {
    const OthersRun others_run;
    const Eigen::MatrixXd plan = procedures::walkPlan(self.arm());
    found = procedures::commission(self.path(), self.overrides(), data, plan);
    if (corrects && !found.findings.empty()) {
      correction = procedures::correct(self.path(), self.overrides(), data, found, 0);
    }
  }
  std::vector<std::string>& findings = found.findings;
  if (!correction.reason.empty()) findings.push_back("not corrected: " + correction.reason);
  const std::string message = findings.empty()
                                  ? "every hose, sensor and tag is where the scene says"
                                  : basics::joined(findings, "; ");
  return py::dict("success"_a = findings.empty() || !correction.scene_text.empty(),
                  "message"_a = message, "warnings"_a = findings,
                  "scene_text"_a = correction.scene_text);
}

std::vector<std::string> tendonsOf(const Scene& scene) {
  std::vector<std::string> out;
  for (int i = 0; i < scene.arm().actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm().actuator(i);
    if (!model::isPressure(actuator.drive)) out.push_back(actuator.name);
  }
  return out;
}

template <class Value>
Value accepted(const control::Checked<Value>& checked) {
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    throw std::invalid_argument(refusal->message);
  }
  return std::get<Value>(checked);
}

void bindWatch(py::module_& module) {
  py::class_<Sample>(module, "Sample")
      .def_readonly("time", &Sample::time)
      .def_readonly("pressure", &Sample::pressure)
      .def_property_readonly("tags", [](const Sample& self) { return self.tags.size(); });
  py::class_<Settling>(module, "Settling")
      .def_property_readonly("state", &nameOfState)
      .def_property_readonly("stale", &Settling::stale)
      .def_readwrite("reason", &Settling::reason)
      .def_readonly("set_point", &Settling::set_point)
      .def_readonly("last", &Settling::last);
  py::class_<SettleRules>(module, "SettleRules")
      .def(py::init<>())
      .def_readwrite("pressure_tolerance", &SettleRules::pressure_tolerance)
      .def_readwrite("corner_tolerance", &SettleRules::corner_tolerance)
      .def_readwrite("body_tolerance", &SettleRules::body_tolerance)
      .def_readwrite("window", &SettleRules::window)
      .def_readwrite("max_age", &SettleRules::max_age);
  py::class_<SettleWatch>(module, "SettleWatch")
      .def(py::init<std::vector<std::string>, const SettleRules&>())
      .def("wait_for_rest", [](SettleWatch& self, const Scene& of) { self.waitForRest(of.arm()); })
      .def("command", &SettleWatch::command)
      .def("measured", &SettleWatch::measured)
      .def("seen", &seePicture)
      .def("seen_bodies", &seeBodies)
      .def("at", &SettleWatch::at)
      .def("samples", &SettleWatch::samples);
  py::class_<SeriesRecord>(module, "SeriesRecord")
      .def(py::init<int>())
      .def("measured", &SeriesRecord::measured)
      .def("seen", &seeTip)
      .def("table", [](const SeriesRecord& self, const std::string& comment) {
        const OthersRun others_run;
        const procedures::ResponseSeries series = self.series();
        return std::pair(series.history.rows(), procedures::tipSeriesCsv(series, comment));
      });
  module.def("_median_of", [](const std::vector<Sample>& samples) { return medianOf(samples); });
}

}  // namespace

void bindRecordings(py::module_& module, py::class_<Scene>& scene) {
  bindWatch(module);
  py::class_<CalibrationData>(module, "CalibrationData")
      .def(py::init<>())
      .def_property_readonly("has_lengths",
                             [](const CalibrationData& self) { return !self.lengths.empty(); });
  scene.def("_measured", &measuredOf)
      .def("_load",
           [](const Scene& self, const std::vector<std::string>& paths, const SettleRules& rules) {
             const OthersRun others_run;
             return ros_bridge::loadMeasurements(self.scene(), paths, rules);
           })
      .def("_sample_table",
           [](const Scene& self, const std::vector<Sample>& samples, const std::string& comment) {
             return ros_bridge::SampleTable(samples, self.scene())
                 .csv(self.arm().actuatorCount(), comment);
           })
      .def("_reading",
           [](const Scene& self, const std::vector<std::string>& names,
              const std::vector<double>& pressures) {
             return accepted(control::checkReading(self.arm(), names, pressures));
           })
      .def("_plan",
           [](const Scene& self, const std::vector<double>& rows, bool loop) {
             return accepted(procedures::checkPlan(self.arm(), rows, loop));
           })
      .def("_walk_plan", [](const Scene& self) { return procedures::walkPlan(self.arm()); })
      .def("_commission", &commissionOf)
      .def_property_readonly("_tendons", &tendonsOf)
      .def_property_readonly(
          "_rest_time_s",
          [](const Scene& self) { return model::ArmResponse(self.arm()).restTime(); })
      .def_property_readonly("_sha256", [](const Scene& self) { return self.scene().sha256; })
      .def_property_readonly(
          "_is_calibrated", [](const Scene& self) { return self.scene().calibration.has_value(); });
  module.def("_sha256", [](const std::string& path) { return io::sha256OfFile(path); });
  module.def("_fits_response", [](const std::vector<std::string>& words) {
    return estimation::fitParametersOf(words, true).count(estimation::FitParameter::kResponse) > 0;
  });
}

}  // namespace helix_arm::python
