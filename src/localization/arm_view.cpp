#include "helix_arm/localization/arm_view.hpp"

#include <algorithm>

namespace helix_arm::estimation {

void ArmView::validate() const {
  if (!layout.hasBodies()) camera.validate();
  layout.validate(sections);
}

std::vector<TagImage> visibleTags(const ArmView& view, const model::Shape& shape,
                                  double least_cosine) {
  std::vector<TagImage> out;
  if (view.layout.hasBodies()) {
    for (int i = 0; i < static_cast<int>(view.layout.tags.size()); ++i) out.push_back({i, {}});
    return out;
  }
  const Corners plane = view.layout.corners();
  const model::Shape::Pieces& pieces = shape.pieces();
  lie::SE3 X_CS = view.X_CB;  // where piece j begins
  for (int j = 0; j < pieces.cols(); ++j) {
    for (std::size_t i = 0; i < view.layout.tags.size(); ++i) {
      const TagPlacement& tag = view.layout.tags[i];
      const PiecePlace place = placeOnPieces(tag, shape.piecesPerSection());
      if (place.piece != j) continue;
      const lie::SE3 X_CT = X_CS * lie::SE3::exp(place.s * pieces.col(j)) * tag.X_ST;
      const double distance = X_CT.translation.norm();
      const double facing = -X_CT.rotation.col(2).dot(X_CT.translation);
      if (!(facing >= least_cosine * distance)) continue;
      TagImage observation{static_cast<int>(i), {}};
      bool visible = true;
      for (int c = 0; c < 4 && visible; ++c) {
        const auto pixel =
            view.camera.project(X_CT * Eigen::Vector3d(plane(0, c), plane(1, c), 0.0));
        visible = pixel && view.camera.contains(*pixel);
        if (visible) observation.corners.col(c) = *pixel;
      }
      if (visible) out.push_back(observation);
    }
    X_CS = shape.beyond(X_CS, j);
  }
  return out;
}

double longestSide(const Corners& corners) {
  double longest = 0;
  for (int c = 0; c < 4; ++c) {
    longest = std::max(longest, (corners.col((c + 1) % 4) - corners.col(c)).norm());
  }
  return longest;
}

std::optional<Corners> directionsOf(const Camera& camera, const Corners& corners) {
  Corners out;
  for (int c = 0; c < 4; ++c) {
    const auto direction = camera.directionOf(corners.col(c));
    if (!direction) return std::nullopt;
    out.col(c) = *direction;
  }
  return out;
}

}  // namespace helix_arm::estimation
