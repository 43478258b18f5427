#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::model {

/// Shape of an arm's base curve, seen from the arm's base: constant twists in series, with the same
/// number of pieces in every section.
///
/// Sections may be followed by rigid links (ArmOf::links()), which are not pieces: s in [k, k + 1)
/// is on section k, and the link of section k lies between its end and the start of section k + 1.
///
/// Without load, one piece per section is exact (X_tip = prod_k exp(g_k)). A load bends a section
/// unevenly along its length. Each section is then cut evenly into pieces whose ends lie on the
/// curve, and each piece is the constant twist between its ends. Between the ends, the piece
/// deviates from the curve by 2e-5 of the length on the helical arm of 50.8 mm under 0.3 kg, and by
/// ten times that where sections are softer or turn more. ArmModel::curve() gives the curve itself.
class Shape {
 public:
  /// Twist of each piece over its own length, (6 x pieces): v [m], w [rad].
  using Pieces = PiecesOf<lie::SE3>;

  /// A shape without sections.
  Shape() = default;
  /// One constant twist per section. Implicit, so that twists of an arm without links can be used
  /// as a shape.
  /// @param links  of the arm; null without any.
  Shape(const Twists& twists, std::shared_ptr<const Links> links = nullptr)
      : pieces_(twists), links_(std::move(links)) {}
  /// @param pieces              (6 x sections * pieces_per_section).
  /// @param pieces_per_section  >= 1.
  /// @throws std::invalid_argument if the pieces are not a whole number of sections, or too many.
  Shape(const Pieces& pieces, int pieces_per_section, std::shared_ptr<const Links> links = nullptr);

  int sectionCount() const { return static_cast<int>(pieces_.cols()) / pieces_per_section_; }
  int piecesPerSection() const { return pieces_per_section_; }
  const Pieces& pieces() const { return pieces_; }
  /// Null without links.
  const std::shared_ptr<const Links>& links() const { return links_; }

  /// The pose where what follows piece j begins, if the piece begins at X: beyond the last piece of
  /// a section, that is beyond its link.
  lie::SE3 beyond(const lie::SE3& X, int j) const {
    const lie::SE3 end = X * lie::SE3::exp(pieces_.col(j));
    const bool last = (j + 1) % pieces_per_section_ == 0;
    return links_ && last ? end * (*links_)[j / pieces_per_section_] : end;
  }

  /// Mean twist of each section over its length (6 x sections): the sum of its pieces. Without
  /// load, these are the twists of the arm.
  Twists twists() const;

  /// The shape with other mean twists (6 x sections), whose pieces keep their deviations from the
  /// mean.
  /// @throws std::invalid_argument on another number of sections.
  Shape about(const Twists& twists) const;

 private:
  Pieces pieces_;
  int pieces_per_section_ = 1;
  std::shared_ptr<const Links> links_;
};

/// The shape of an unloaded arm with given twists (6 x sections).
inline Shape shapeOf(const Arm& arm, const Twists& twists) { return {twists, arm.links()}; }
/// The shape of an unloaded arm; a tapered section has several pieces.
inline Shape shapeOf(const Arm& arm, const Unloaded& unloaded) {
  if (!arm.tapered()) return {unloaded.twists, arm.links()};
  return {arm.pieces(unloaded), arm.piecesPerSection(), arm.links()};
}

}  // namespace helix_arm::model
