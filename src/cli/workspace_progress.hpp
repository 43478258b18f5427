#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace helix_arm::cli {

/// "8.74 million points/s".
std::string rateText(double points_per_second);

/// Tells on stderr how far the points are, how fast they come and how long the rest takes: on a
/// terminal one line that is rewritten, else a line every 10 %.
class Progress {
 public:
  /// @param total  points, > 0.
  explicit Progress(std::uint64_t total);
  /// Ends the line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// So many are done now.
  void reached(std::uint64_t done);
  /// Since it was made [s].
  double seconds() const;

 private:
  const std::uint64_t total_;
  const bool terminal_;
  const std::chrono::steady_clock::time_point start_;
  double last_ = 0.0;     // when the terminal's line was last written [s]
  int tenths_ = 0;        // that were told
  bool written_ = false;  // something stands on the terminal's line
};

}  // namespace helix_arm::cli
