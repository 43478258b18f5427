#pragma once

namespace helix_arm::estimation {

/// What LoadForks assume.
struct LoadForksOptions {
  /// Score beyond which something touches the arm, > 0. A lower one finds lighter contacts, and
  /// more that are none.
  double limit = 32.0;
  double deviation = 1.0;  ///< standard deviation of each entry of a force, > 0 [N]
  double creep = 0.05;     ///< of the force, >= 0 [N s^-1/2]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

}  // namespace helix_arm::estimation
