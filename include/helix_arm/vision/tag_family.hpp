#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

struct apriltag_family;

namespace helix_arm::vision {

/// One of libapriltag's families of tags, by name: 36h11, 25h9, 16h5, 36h10, Circle21h7,
/// Circle49h12, Custom48h12, Standard41h12 or Standard52h13.
class TagFamily {
 public:
  /// @throws std::invalid_argument naming the families there are.
  explicit TagFamily(const std::string& name);

  static std::vector<std::string> names();

  const std::string& name() const { return name_; }
  int count() const;     ///< ids are 0 .. count - 1
  int bitCount() const;  ///< of one tag
  int distance() const;  ///< bits in which any two tags differ at least

  /// One pixel (0 or 255) a cell, all around the border included, as one reads the tag.
  /// @throws std::out_of_range on an unknown id.
  cv::Mat cells(int id) const;
  /// The square whose corners a detector finds is the outer edge of the black border, or, of the
  /// families that have bits outside it (Circle, Custom, Standard), the inner edge of the black
  /// ring. Cells from the edge of that picture to that square, on each side.
  int quietCells() const;
  /// Cells along a side of that square.
  int borderCells() const;
  /// True where that square is white inside, and black around it.
  bool isReversed() const;

  /// For one detector, which writes to it; lives as long as any copy of this.
  apriltag_family* get() const { return family_.get(); }

 private:
  std::string name_;
  std::shared_ptr<apriltag_family> family_;
};

}  // namespace helix_arm::vision
