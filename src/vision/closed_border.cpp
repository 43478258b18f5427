#include "closed_border.hpp"

#include <opencv2/core.hpp>

namespace helix_arm::vision {

bool hasClosedBorder(const TagFamily& family) {
  const int within = family.borderCells() - 2;
  return family.borderCells() <= kMostCells && family.bitCount() == within * within;
}

TagPattern patternOf(const TagFamily& family, int id) {
  const cv::Mat cells = family.cells(id);
  TagPattern pattern{family.borderCells(), 0};
  const int first = family.quietCells() + 1, within = pattern.cells - 2;
  for (int bit = 0; bit < within * within; ++bit) {
    const bool white = cells.at<std::uint8_t>(first + bit / within, first + bit % within) != 0;
    pattern.white |= std::uint64_t{white} << bit;
  }
  return pattern;
}

}  // namespace helix_arm::vision
