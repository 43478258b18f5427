#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/reload_server.hpp"

namespace helix_arm::ros_bridge {

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

}  // namespace helix_arm::ros_bridge
