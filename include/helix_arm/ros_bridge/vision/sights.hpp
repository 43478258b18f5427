#pragma once

#include <string>
#include <vector>

#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/ros_bridge/common/model_history.hpp"
#include "helix_arm/vision/arm_localizer.hpp"

/// What is seen in a picture, as messages and as words.
namespace helix_arm::ros_bridge {

/// `3, 4, 7`; the first few of many.
std::string listOf(const std::vector<int>& ids);

/// How the tag with this id agrees with the measured shape; null where it took no part in it.
const estimation::TagResidual* residualOf(const vision::Sight& sight,
                                          const estimation::TagLayout& layout, int id);

/// Tags of the arm in sight, each seen once.
int tagsOfArm(const vision::Sight& sight);

/// @param header  the picture's.
TagDetections toMsg(const std_msgs::Header& header, const vision::Sight& sight,
                    const estimation::TagLayout& layout);

/// Measured shape less the model's, both seen from their base.
///
/// @param header  the picture's stamp and the frame of the arm's base.
ModelError toMsg(const std_msgs::Header& header, const estimation::TwistFit& fit,
                 const ModelHistory::Entry& model);

/// Largest standard deviation of the measured tip over all directions [m].
double tipSigma(const estimation::TwistFit& fit);

/// `8 tags, 0.20 px, tip to 0.5 mm`: of a measured shape, in few words.
std::string summarise(const vision::Sight& sight);

/// What is seen: the summary where the shape is measured, else why it is not and what to look
/// after; and the ids of no use.
///
/// @param config  of the localizer that looked.
std::string describe(const vision::Sight& sight, const vision::LocalizerConfig& config);

}  // namespace helix_arm::ros_bridge
