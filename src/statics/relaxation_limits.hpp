#pragma once

/// Tolerances of the loaded tier.
namespace helix_arm::statics {

inline constexpr int kMaxIterations = 100;
// Largest change at convergence, relative to the arm's size and one radian.
inline constexpr double kAtRest = 1e-11;
// The step of the lowest order is accepted if the next step would be shorter by this factor and at
// most this long, relative to the arm's size and one radian.
inline constexpr double kContracting = 0.5;
inline constexpr double kTrustedStep = 0.02;
// Rotation of a section relative to its unloaded shape beyond which its coordinates are ambiguous
// [rad].
inline constexpr double kFarthestTurn = 5.5;
inline constexpr double kFarthestResidual = 1e6;
inline constexpr double kNoWork = 1e-9;  // work of a wrench on a null space, relative to the load's

// Fraction of the order's stated error that the error estimate may reach. Beyond it, the shape is
// compared with a finer solution.
inline constexpr double kDoubt = 0.25;
// Limit of the rates in the highest mode, relative to the arm's size and one radian.
inline constexpr double kLargestTail = 0.065;
// Turn of an element that is not resolved at all [rad]: per Gauss point, and as a whole for the
// less accurate single step.
inline constexpr double kTurnOfNode = 3.0;
inline constexpr double kTurnOfOneStep = 20.0;
// Largest turn that the finer solution resolves [rad], and the permitted difference from it as a
// fraction of the stated error.
inline constexpr double kFinestTurn = 40.0;
inline constexpr double kAgreement = 0.7;
inline constexpr double kLargestAmplification = 1.0 - 1e-9;

// Stiffness of a shape that may have another beside it: 2 a = 1/4 of the square of its turn [rad],
// and as much to spare.
inline constexpr double kBranching = 0.5;
// Load steps, relative to the whole load.
inline constexpr double kFirstLoadStep = 0.25;
inline constexpr double kLeastLoadStep = 1e-3;
// Distance of a step's shape from the predicted one: relative to the step, or to the arm's size and
// one radian.
inline constexpr double kOnBranch = 0.5;
inline constexpr double kNearBranch = 0.05;

}  // namespace helix_arm::statics
