#pragma once

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
  /// @throws std::invalid_argument naming the known families.
  explicit TagFamily(const std::string& name);

  static std::vector<std::string> names();

  const std::string& name() const { return name_; }
  int count() const;     ///< ids are 0 .. count - 1
  int bitCount() const;  ///< of one tag
  int distance() const;  ///< minimum number of bits in which two tags differ

  /// One pixel (0 or 255) per cell, including the border and what surrounds it, as one reads the
  /// tag.
  /// @throws std::out_of_range on an unknown id.
  cv::Mat cells(int id) const;
  /// Number of cells between the edge of cells() and the square whose corners a detector finds, on
  /// each side. That square is the outer edge of the black border; in families with bits outside it
  /// (Circle, Custom, Standard), the inner edge of the black ring.
  int quietCells() const;
  /// Number of cells along a side of the detected square.
  int borderCells() const;
  /// True if the detected square is white inside and black around it.
  bool isReversed() const;

  /// For one detector, which writes to it. Valid as long as any copy of this object.
  apriltag_family* get() const { return family_.get(); }

 private:
  std::string name_;
  std::shared_ptr<apriltag_family> family_;
};

}  // namespace helix_arm::vision
