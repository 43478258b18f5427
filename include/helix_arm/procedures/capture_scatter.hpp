#pragma once

#include <string>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/estimation/capture_check.hpp"
#include "helix_arm/io/scene.hpp"

/// Captures that no shape explains, see estimation::checkCaptures().
namespace helix_arm::procedures {

/// Of tag positions.
estimation::CaptureScatter scatterOfPoses(const estimation::TwistFit& fit, bool planar);

/// "no shape explains it: its tags are off by RMS 54.0 mm, usual are 13.7 mm; ...".
std::string scatterText(double rms, double usual);

/// One warning for each capture of tag positions that no shape explains.
std::vector<std::string> warningsOfScatter(const io::Scene& scene,
                                           const std::vector<estimation::Capture>& captures);

}  // namespace helix_arm::procedures
