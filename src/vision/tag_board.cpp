#include "helix_arm/vision/tag_board.hpp"

#include <stdexcept>

namespace helix_arm::vision {

estimation::Corners TagBoard::corners(int id) const {
  if (!has(id)) {
    throw std::out_of_range("tag id is " + std::to_string(id) + "; the board has " +
                            std::to_string(first_id) + " to " +
                            std::to_string(first_id + count() - 1));
  }
  const int column = (id - first_id) % columns, row = (id - first_id) / columns;
  const Eigen::Vector2d centre(column - 0.5 * (columns - 1), 0.5 * (rows - 1) - row);
  const estimation::TagLayout tag{tag_size, {}};
  return tag.corners().colwise() + (pitch * centre).eval();
}

BoardParts TagBoard::parts() const {
  return {"tags", 4, 6, "print it with helix_arm tags --board and take 15 pictures or more"};
}

}  // namespace helix_arm::vision
