#pragma once

#include <Eigen/Core>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::model {

/// The most pieces that a shape is made of.
inline constexpr int kMaxPieces = 128;

/// Shape of an arm's base curve: constant twists in series, as many a section.
///
/// Where nothing loads the arm, one piece a section is all of it (X_tip = prod_k exp(g_k)). A load
/// bends a section differently along its length: then each section is cut evenly into pieces whose
/// ends lie on the curve, and each piece is the constant twist from one end to the next. Between
/// the ends it leaves the curve by 2e-5 of the length on the helical arm of
/// 50.8 mm under 0.3 kg, by ten times that where sections are softer or turn more;
/// ArmModel::curve() gives the curve itself. Seen from the arm's base.
class Shape {
 public:
  /// Twists of the pieces, each over its own length, (6 x pieces): v [m], w [rad].
  using Pieces = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxPieces>;

  /// No section at all.
  Shape() = default;
  /// One constant twist a section. Implicit: that is what twists are.
  Shape(const Twists& twists) : pieces_(twists) {}
  /// @param pieces              (6 x sections * pieces_per_section).
  /// @param pieces_per_section  >= 1.
  /// @throws std::invalid_argument where they are not a whole number of sections, or too many.
  Shape(const Pieces& pieces, int pieces_per_section);

  int sectionCount() const { return static_cast<int>(pieces_.cols()) / pieces_per_section_; }
  int piecesPerSection() const { return pieces_per_section_; }
  const Pieces& pieces() const { return pieces_; }

  /// Mean twist of each section over its length (6 x sections): the sum of its pieces. Of an arm
  /// without load, its twists.
  Twists twists() const;

  /// The shape with other mean twists (6 x sections) whose pieces deviate from them as these do.
  /// @throws std::invalid_argument on another number of sections.
  Shape about(const Twists& twists) const;

 private:
  Pieces pieces_;
  int pieces_per_section_ = 1;
};

}  // namespace helix_arm::model
