#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/calibration_run.hpp"
#include "helix_arm/procedures/calibration_words.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/reload_server.hpp"

/// What the services of calibration and its action answer.
namespace helix_arm::ros_bridge {

/// Runs what answers a service; what it throws is the answer.
/// @return true: the answer is sent.
template <class Response, class Body>
bool answer(const char* service, Response& response, const Body& body) {
  try {
    body();
  } catch (const std::exception& fault) {
    response.success = false;
    response.message = basics::printableLines(fault.what());
  }
  if (response.success) {
    logInfo("%s: %s", service, response.message.c_str());
  } else {
    logWarning("%s: %s", service, response.message.c_str());
  }
  return true;
}

/// Fills the response of the service or the result of the action.
/// @param path  Of the calibrated scene.
template <class Answer>
void fill(Answer& out, const procedures::CalibrationOutcome& outcome, const std::string& path) {
  out.success = outcome.success;
  out.message = outcome.message;
  out.warnings = outcome.warnings;
  out.held_out_error = std::numeric_limits<double>::quiet_NaN();
  constexpr double kUndetermined = std::numeric_limits<double>::quiet_NaN();
  out.tip_error_before = outcome.tip_error_before.value_or(kUndetermined);
  out.tip_error_after = outcome.tip_error_after.value_or(kUndetermined);
  if (outcome.success) out.out = path;
  for (const estimation::Parameter& parameter : procedures::parametersOf(outcome)) {
    out.names.push_back(parameter.name);
    out.units.push_back(parameter.unit);
    out.initial.push_back(parameter.initial);
    out.values.push_back(parameter.value);
    out.standard_errors.push_back(parameter.standard_error);
    out.identifiable.push_back(parameter.identifiable);
  }
  if (outcome.response) {
    out.rms = outcome.response->fit.rms;
    out.error_unit = "m";
  }
  if (!outcome.calibration) return;
  const estimation::Calibration& calibration = *outcome.calibration;
  out.rms = calibration.rms;
  out.error_unit = calibration.error_unit;
  if (calibration.by_pressure) out.held_out_error = calibration.by_pressure->error;
  for (const Eigen::VectorXd& row : calibration.next_pressures) {
    out.next_pressures.insert(out.next_pressures.end(), row.begin(), row.end());
  }
}

/// The one long job that the calibration node does at a time: a run of its action, or the fit of a
/// service. While a job holds the slot, no other starts, and neither samples nor scene are changed
/// from outside. From any thread.
///
/// Its mutex is locked after that of ReloadServer, and before those of Recorder and Calibrator.
class JobSlot {
 public:
  enum class Job {
    kNone,
    kRun,  ///< run_calibration
    kFit,  ///< the fit of a service
  };

  /// Holds the slot as long as it lives.
  class Claim {
   public:
    /// @throws std::invalid_argument naming the job that is under way.
    Claim(JobSlot& slot, Job job);
    ~Claim();
    Claim(const Claim&) = delete;
    Claim& operator=(const Claim&) = delete;

   private:
    JobSlot& slot_;
  };

  bool runs() const HELIX_ARM_EXCLUDES(mutex_);  ///< run_calibration is under way

  /// Runs a short body; no job starts meanwhile.
  /// @return what the body returns.
  /// @throws std::invalid_argument naming the job that is under way, and what the body throws.
  template <class Body>
  auto whileIdle(const Body& body) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    requireIdle();
    return body();
  }

 private:
  void requireIdle() const HELIX_ARM_REQUIRES(mutex_);

  mutable basics::Mutex mutex_;
  Job job_ HELIX_ARM_GUARDED_BY(mutex_) = Job::kNone;
};

/// Reads data sets, fits the file of the node's scene, writes the calibrated scene, and keeps the
/// last one. From any thread; no file is read or written and nothing is fitted under its lock.
class Calibrator {
 public:
  using SceneFile = std::function<ReloadServer::File()>;

  /// Makes the folders where they are missing; warns where that fails.
  ///
  /// @param data_folder, out_folder  Data sets are read below both; scenes and samples are written
  ///                                 below the second.
  /// @param rules       When the arm of a recording stands still.
  /// @param scene_file  The file of the node's scene.
  Calibrator(const std::string& data_folder, const std::string& out_folder,
             const procedures::SettleRules& rules, SceneFile scene_file);

  // Paths without links, of what a request names.
  // Each throws std::invalid_argument where the node may not read or write it.
  std::string tablePath(const std::string& data) const;  ///< of a data set to read (.csv)
  /// Where a calibrated scene goes; empty stays empty.
  std::string scenePath(const std::string& out) const;
  std::string savePath(const std::string& path) const;  ///< of a scene or of samples to write

  /// Reads data sets of all kinds, recordings included.
  /// @throws std::invalid_argument where one may not be read, io::DocumentError with every fault of
  /// a file.
  procedures::CalibrationData load(const io::Scene& scene,
                                   const std::vector<std::string>& paths) const;

  /// @throws std::invalid_argument where the words are none of CalibrationRequest::fit,
  /// DocumentError where the scene has faults.
  void check(const std::vector<std::string>& fit) const;

  /// Fits, and writes the scene when there is a path and nobody has cancelled it meanwhile.
  ///
  /// @param out        As scenePath() returned it; checked again before the scene is written.
  /// @param cancelled  Asked once, after the fit.
  /// @throws std::invalid_argument where the scene's file has changed since it was loaded, and as
  /// procedures::runCalibration().
  procedures::CalibrationOutcome calibrate(const procedures::CalibrationRequest& request,
                                           const procedures::CalibrationData& data,
                                           const std::string& out,
                                           const std::function<bool()>& cancelled)
      HELIX_ARM_EXCLUDES(mutex_);

  /// Text of the last scene that was calibrated; absent where there is none.
  std::optional<std::string> last() const HELIX_ARM_EXCLUDES(mutex_);
  void forgetLast() HELIX_ARM_EXCLUDES(mutex_);

 private:
  const FileAccess data_access_, out_access_;
  const procedures::SettleRules rules_;
  const SceneFile scene_file_;
  mutable basics::Mutex mutex_;
  std::optional<std::string> last_ HELIX_ARM_GUARDED_BY(mutex_);
};

class Recorder;

/// Serves the action ~run_calibration as long as the result lives.
/// @param rules  Of each run, except for the captures, which a goal gives.
/// @param rate   Of the targets during a run [Hz].
/// @param jobs, recorder, calibrator  These outlive it.
std::shared_ptr<void> serveRuns(ros::NodeHandle& node, ros::NodeHandle& private_node,
                                const procedures::RunRules& rules, double rate, JobSlot& jobs,
                                Recorder& recorder, Calibrator& calibrator);

}  // namespace helix_arm::ros_bridge
