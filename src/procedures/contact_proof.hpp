#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/tracking/onset_hypotheses.hpp"

namespace helix_arm::procedures {

/// Which score the watch for contacts reaches on an arm that nobody touches, and what follows from
/// it. On the simulated rig:
///
///     FollowPlan plan;
///     plan.seconds = 400;
///     plan.path = quietPath(scene, plan.seconds, plan.seed);
///     plan.ignore_contacts = true;
///     const ContactProof proof = contactProof(scene, runFollow(scene, plan).quiet);
///     const std::string proven = provenSceneText("arm.yaml", {}, proof);
struct ContactProof {
  estimation::QuietScore quiet;
  double limit;  ///< for follow.contact_limit: twice the highest score, at least the default
  /// For follow.on_contact: yield, or stop if the scene stops, if nothing speaks against it; else
  /// report.
  follow::OnContact on_contact;
  std::string doubt;  ///< what speaks against it, and the remedy; empty if nothing does
  /// Across the resting tip in its weakest direction, which is found within half a second in 9 of
  /// 10 cases [N]; divided by K_eps if `normalised`.
  double force;
  bool normalised;  ///< the scene has no K_eps
};

/// Default duration of a proof [s].
inline constexpr double kProofTime = 400.0;

/// A path for such an arm: moves between random shapes, nearly as fast as safety.slew_kpa_s allows,
/// each with four seconds of rest after it. The pressures of all actuators move together, so the
/// whole path is within the model's reach.
/// @param scene    driven by pressures. @param seconds  which it takes at least, > 0 [s].
/// @param seed     of the shapes.
/// @throws std::invalid_argument if no shape balances the scene's load.
control::TipPath quietPath(const io::Scene& scene, double seconds, std::uint32_t seed);

/// @param quiet  of a loop that followed the path with VisualServo::ignoreContacts().
ContactProof contactProof(const io::Scene& scene, const estimation::QuietScore& quiet);

/// The text of the scene's file with the limit and the reaction of a proof, which a comment at its
/// begin gives with its date; other comments are not kept.
/// @throws io::DocumentError as io::calibratedSceneText().
std::string provenSceneText(const std::string& path, const std::vector<io::Override>& overrides,
                            const ContactProof& proof);

}  // namespace helix_arm::procedures
