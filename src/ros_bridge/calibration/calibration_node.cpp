#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <ros/node_handle.h>

#include "calibrator.hpp"
#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/Save.h"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "recorder.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

template <class Value>
Value wordOf(const char* what, const std::string& given,
             const std::vector<std::pair<const char*, Value>>& words) {
  if (given.empty()) return words.front().second;
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    list += (list.empty() ? "" : " or ") + std::string(word);
  }
  throw std::invalid_argument(std::string(what) + " is '" + basics::quoted(given) + "'; expected " +
                              list);
}

procedures::CalibrationRequest requestOf(const Calibrate::Request& request) {
  procedures::CalibrationRequest out;
  out.fit = request.fit;
  out.curvature_noise = request.curvature_noise_rad;
  out.corner_noise = request.corner_noise_px;
  out.position_noise = request.position_noise_m;
  out.rotation_noise = request.rotation_noise_rad;
  out.date = procedures::utcNow();
  return out;
}

procedures::CalibrationRequest requestOf(const FitContraction::Request& request) {
  using estimation::Branch;
  using estimation::CurveKind;
  procedures::CalibrationRequest out;
  out.fit = {"contraction"};
  out.contraction = request.contraction;
  out.curve = wordOf<CurveKind>("kind", request.kind,
                                {{"quintic", CurveKind::kQuintic}, {"table", CurveKind::kTable}});
  out.branch = wordOf<Branch>(
      "branch", request.branch,
      {{"both", Branch::kBoth}, {"rising", Branch::kRising}, {"falling", Branch::kFalling}});
  out.date = procedures::utcNow();
  return out;
}

void fillCurve(FitContraction::Response& response, const estimation::ContractionFit& fit) {
  if (!fit.curve) return;
  response.rms = fit.rms;
  response.constrained = fit.constrained;
  if (fit.hysteresis) response.hysteresis = *fit.hysteresis;
  if (fit.kind == estimation::CurveKind::kQuintic) {
    response.coefficients.assign(fit.coefficients.begin(), fit.coefficients.end());
    response.reference_pressure = fit.reference_pressure;
  } else {
    response.pressures = fit.pressures;
    response.lengths = fit.lengths;
  }
}

bool neverCancelled() { return false; }

/// Private parameters of calibration.
struct CalibrationNodeOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  procedures::SettleRules settle;  ///< when the arm stands still, and when measurements are stale
  procedures::RunRules run;        ///< of run_calibration, except the captures
  double rate = 50.0;              ///< of the targets during run_calibration [Hz]
  std::string scene_folder;        ///< as pressure_command's
  /// Below which data sets are read (of either), and scenes and samples are written (of the
  /// second); made where they are missing.
  std::string data_folder, out_folder;

  CalibrationNodeOptions() {
    settle.pressure_tolerance = 1e3 * reader.number("pressure_tolerance_kpa",
                                                    1e-3 * settle.pressure_tolerance, {0.01, 100});
    settle.corner_tolerance =
        reader.number("corner_tolerance_px", settle.corner_tolerance, {0.01, 100});
    settle.window = reader.number("window_s", settle.window, {0.05, 60});
    settle.max_age = reader.number("max_age_s", settle.max_age, {0.05, 60});
    run.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * run.ramp, {0.1, 10000});
    run.patience = reader.number("patience_s", run.patience, {0.1, 3600});
    rate = reader.number("rate", rate, {5, 1000});
    scene_folder = reader.folder("scene_folder", defaultFolder());
    data_folder = reader.folder("data_folder", defaultFolder());
    out_folder = reader.folder("out_folder", defaultFolder());
    reader.finish();
  }
};

/// Records the arm where it stands still, and calibrates the scene with what was recorded or with
/// data sets.
///
/// Subscribes
/// - tag_detections (TagDetections), vision_status (VisionStatus), measured (ArmShape): of vision
/// - pressure_measured, pressure_command (PressureArray); target_status (TargetStatus)
///
/// Publishes
/// - pressure_target (PressureArray): during run_calibration alone; all actuators, gauge [Pa]
///
/// Services
/// - ~calibrate (Calibrate), ~fit_contraction (FitContraction): fit, and write a scene file
/// - ~record_sample (RecordSample), ~clear_samples (ClearSamples), ~save (Save)
/// - ~reload (Reload): another file of the same rig; samples stay
///
/// Action
/// - ~run_calibration (RunCalibration): forgets what was recorded, ramps the pressures through a
///   plan, waits at each until the arm stands still, records it, ramps down, calls
///   pressure_command/rest and calibrates. Preempted, without fresh measurements, where the arm
///   does not settle, and when the node is to end, it ramps down and ends without a calibration;
///   what was recorded stays. When another commander has the arm, it ends and leaves the arm to it.
///
/// Parameters: CalibrationNodeOptions.
///
/// Ages and windows go by the stamps of messages and ROS time, so that simulated time may run fast.
/// Where ROS time stands still the run ends, and ramps down by a steady clock.
///
/// Messages, services and ~reload are handled in the spinning thread, run_calibration in a thread
/// of its own. Locks in their order: ReloadServer, JobSlot or RunAction, Recorder or Calibrator.
///
/// Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad scene or parameter.
class CalibrationNode : public Node {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  CalibrationNode()
      : recorder_(node_, requirePneumatic(io::loadScene(options_.scene)), options_.settle),
        calibrator_(options_.data_folder, options_.out_folder, options_.settle,
                    [this] { return reload_.file(); }),
        calibrate_(serve(private_node_, names::kCalibrate, &Self::onCalibrate, this)),
        fit_contraction_(
            serve(private_node_, names::kFitContraction, &Self::onFitContraction, this)),
        record_(serve(private_node_, names::kRecordSample, &Self::onRecord, this)),
        clear_(serve(private_node_, names::kClearSamples, &Self::onClear, this)),
        save_(serve(private_node_, names::kSave, &Self::onSave, this)),
        reload_(private_node_, options_.scene, options_.scene_folder,
                [this](io::Scene next) { adopt(std::move(next)); }),
        run_(serveRuns(node_, private_node_, options_.run, options_.rate, jobs_, recorder_,
                       calibrator_)) {
    const io::Scene scene = recorder_.scene();
    logInfo("%s: %s", scene.name.c_str(),
            scene.camera && scene.tags
                ? "ready to record and to calibrate"
                : "ready to calibrate from data sets; its scene lacks `camera` or `tags`, so "
                  "nothing can be recorded");
  }

  /// Not while run_calibration is under way: the arm is to be ramped down first.
  bool mayEnd() const override { return !jobs_.runs(); }

 private:
  using Self = CalibrationNode;

  // Services. While run_calibration is under way, each is refused.
  bool onCalibrate(Calibrate::Request& request, Calibrate::Response& response) {
    response.held_out_error = std::numeric_limits<double>::quiet_NaN();
    return answer(names::kCalibrate, response, [&] {
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit(jobs_, JobSlot::Job::kFit);
      const procedures::CalibrationData data =
          request.data.empty() ? recorder_.recording().data()
                               : calibrator_.load(recorder_.scene(), request.data);
      fill(response, calibrator_.calibrate(requestOf(request), data, out, neverCancelled), out);
    });
  }

  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response) {
    response.hysteresis = std::numeric_limits<double>::quiet_NaN();
    return answer(names::kFitContraction, response, [&] {
      const procedures::CalibrationRequest job = requestOf(request);
      const std::string path = calibrator_.tablePath(request.data);
      const std::string out = calibrator_.scenePath(request.out);
      const JobSlot::Claim fit(jobs_, JobSlot::Job::kFit);
      const procedures::CalibrationData data =
          procedures::loadCalibrationData(recorder_.scene(), {path});
      basics::require(!data.lengths.empty(), path,
                      " holds no free lengths; expected the columns pressure_kpa and length_m");
      const procedures::CalibrationOutcome outcome =
          calibrator_.calibrate(job, data, out, neverCancelled);
      response.success = outcome.success;
      response.message = outcome.message;
      if (outcome.success) response.out = out;
      if (!outcome.contractions.empty()) {
        fillCurve(response, outcome.contractions.front().second);
      }
    });
  }

  bool onRecord(RecordSample::Request&, RecordSample::Response& response) {
    return answer(names::kRecordSample, response, [&] {
      response.samples = static_cast<std::uint32_t>(recorder_.count());
      jobs_.whileIdle([&] {
        const procedures::Sample sample = recorder_.record();
        response.samples = static_cast<std::uint32_t>(recorder_.count());
        response.tags = static_cast<std::uint32_t>(sample.tags.size());
        response.pressure.assign(sample.pressure.begin(), sample.pressure.end());
      });
      response.success = true;
      response.message = "sample " + std::to_string(response.samples) + " with " +
                         std::to_string(response.tags) + " tags";
    });
  }

  bool onClear(ClearSamples::Request&, ClearSamples::Response& response) {
    return answer(names::kClearSamples, response, [&] {
      jobs_.whileIdle([&] {
        response.cleared = static_cast<std::uint32_t>(recorder_.clear());
        calibrator_.forgetLast();
      });
      response.success = true;
      response.message = std::to_string(response.cleared) + " samples cleared";
    });
  }

  bool onSave(Save::Request& request, Save::Response& response) {
    return answer(names::kSave, response, [&] {
      const std::string path = calibrator_.savePath(request.path);
      const auto [recording, last] =
          jobs_.whileIdle([&] { return std::pair(recorder_.recording(), calibrator_.last()); });
      std::string text;
      if (std::filesystem::path(path).extension() == ".csv") {
        basics::require(!recording.samples.empty(),
                        "no sample was recorded; call record_sample first");
        text = recording.table();
        response.message = std::to_string(recording.samples.size()) + " samples in " + path;
        if (!recording.series.empty()) {
          const std::string beside = calibrator_.savePath(
              std::filesystem::path(path).replace_extension().string() + "_series.csv");
          io::writeFileAtomically(beside, recording.seriesTable());
          response.message += " and a series of " +
                              std::to_string(recording.series.history.rows()) + " rows in " +
                              beside;
        }
      } else {
        basics::require(last.has_value(), "nothing was calibrated; call calibrate first");
        text = *last;
        response.message = "the last calibration of " + recording.scene.name + " in " + path;
      }
      io::writeFileAtomically(path, text);
      response.success = true;
    });
  }

  void adopt(io::Scene next) {
    jobs_.whileIdle([&] {
      recorder_.adopt(std::move(next));
      calibrator_.forgetLast();
    });
  }

  const CalibrationNodeOptions options_{};
  ros::NodeHandle node_, private_node_{"~"};
  JobSlot jobs_;
  Recorder recorder_;
  Calibrator calibrator_;
  ros::ServiceServer calibrate_, fit_contraction_, record_, clear_, save_;
  ReloadServer reload_;
  const std::shared_ptr<void> run_;  ///< last: its thread uses all of the above
};

}  // namespace

std::unique_ptr<Node> makeCalibration() { return std::make_unique<CalibrationNode>(); }

}  // namespace helix_arm::ros_bridge
