#pragma once

#include <ros/node_handle.h>

#include "helix_arm/Calibrate.h"
#include "helix_arm/ClearSamples.h"
#include "helix_arm/FitContraction.h"
#include "helix_arm/RecordSample.h"
#include "helix_arm/Save.h"
#include "ros_bridge/calibration/calibrator.hpp"
#include "ros_bridge/calibration/job_slot.hpp"
#include "ros_bridge/calibration/recorder.hpp"

namespace helix_arm::ros_bridge {

/// Serves ~record_sample, ~clear_samples, ~save, ~calibrate and ~fit_contraction, in the spinning
/// thread. While run_calibration is under way, each is refused.
class CalibrationServices {
 public:
  /// @param node  The private one.
  /// @param jobs, recorder, calibrator  These outlive it.
  CalibrationServices(ros::NodeHandle& node, JobSlot& jobs, Recorder& recorder,
                      Calibrator& calibrator);
  CalibrationServices(const CalibrationServices&) = delete;
  CalibrationServices& operator=(const CalibrationServices&) = delete;

 private:
  bool onCalibrate(Calibrate::Request& request, Calibrate::Response& response);
  bool onFitContraction(FitContraction::Request& request, FitContraction::Response& response);
  bool onRecord(RecordSample::Request& request, RecordSample::Response& response);
  bool onClear(ClearSamples::Request& request, ClearSamples::Response& response);
  bool onSave(Save::Request& request, Save::Response& response);

  JobSlot& jobs_;
  Recorder& recorder_;
  Calibrator& calibrator_;
  ros::ServiceServer calibrate_, fit_contraction_, record_, clear_, save_;
};

}  // namespace helix_arm::ros_bridge
