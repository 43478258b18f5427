#pragma once

#include <vector>

#include "calibration_job.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/calibration/contraction_fit.hpp"

/// A contraction curve that is fitted to free lengths and to captures of an arm together.
namespace helix_arm::procedures {

/// The fit of arms with their curve, and whether it is one of the muscle.
struct CurveFit {
  CurveInArm verdict;
  estimation::ContractionFit contraction;
  estimation::Calibration calibration;
};

/// Marks the actuators that follow a curve: those of the first arm that have it, and those of the
/// other arms that had the same curve as one of them before.
///
/// @param before  the first arm with its previous curves.
/// @param arms  the first one with the new curve.
/// @return names of the other arms that do not follow it.
std::vector<std::string> shareCurve(const model::Arm& before,
                                    const estimation::ContractionFit& curve,
                                    std::vector<estimation::ArmCaptures>& arms);

/// Fits arms with their curve, and judges the curve against the one of the free lengths alone.
///
/// @param alone  the arms calibrated with that curve; must be calibrated.
CurveFit fitCurveInArm(const std::vector<estimation::ArmCaptures>& arms,
                       estimation::CalibrationOptions options,
                       const estimation::ContractionFit& curve,
                       const std::vector<estimation::LengthSample>& lengths,
                       estimation::Branch branch, const estimation::Calibration& alone);

}  // namespace helix_arm::procedures
