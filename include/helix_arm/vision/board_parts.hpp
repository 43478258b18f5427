#pragma once

#include <string>

namespace helix_arm::vision {

/// What messages call the parts of a calibration board, and how many of them a picture must show.
struct BoardParts {
  std::string name;    ///< plural, as in "tags of the board"
  int corners = 1;     ///< of each part
  int least = 0;       ///< fewest parts in a picture that counts
  std::string remedy;  ///< how to get pictures of such a board

  int leastCorners() const { return least * corners; }
};

}  // namespace helix_arm::vision
