#include "helix_arm/model/shape.hpp"

#include <utility>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {

Shape::Shape(const Pieces& pieces, int pieces_per_section, std::shared_ptr<const Links> links)
    : pieces_(pieces), pieces_per_section_(pieces_per_section), links_(std::move(links)) {
  basics::requireValue(pieces_per_section >= 1, "shape", "the number of pieces per section",
                       pieces_per_section, "at least 1");
  basics::requireValue(pieces.cols() % pieces_per_section == 0 && sectionCount() <= kMaxSections,
                       "shape", "the number of pieces", pieces.cols(),
                       "a whole number of sections, at most 16 of them");
}

Twists Shape::twists() const {
  if (pieces_per_section_ == 1) return pieces_;
  Twists out(6, sectionCount());
  for (int k = 0; k < sectionCount(); ++k) {
    out.col(k) = pieces_.middleCols(k * pieces_per_section_, pieces_per_section_).rowwise().sum();
  }
  return out;
}

Shape Shape::about(const Twists& twists) const {
  basics::requireValue(twists.cols() == sectionCount(), "shape",
                       "the number of sections of other twists", twists.cols(),
                       "the same number as the shape");
  if (pieces_per_section_ == 1) return {twists, links_};
  Shape out = *this;
  const Twists moved = (twists - this->twists()) / pieces_per_section_;
  for (int j = 0; j < pieces_.cols(); ++j) out.pieces_.col(j) += moved.col(j / pieces_per_section_);
  return out;
}

}  // namespace helix_arm::model
