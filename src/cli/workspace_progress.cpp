#include "workspace_progress.hpp"

#include <cmath>
#include <cstdio>
#include <iomanip>
#include <iostream>
#include <sstream>

#include <unistd.h>

namespace helix_arm::cli {
namespace {

constexpr double kRewritePeriod = 0.2;  // [s]
const char* const kEraseToEnd = "\x1b[K";

std::string durationText(double seconds) {
  const auto whole = static_cast<long>(std::ceil(seconds));
  std::ostringstream text;
  if (whole >= 3600) text << whole / 3600 << " h ";
  if (whole >= 60) text << whole / 60 % 60 << " min ";
  if (whole < 3600) text << whole % 60 << " s ";
  return text.str() + "left";
}

}  // namespace

std::string rateText(double points_per_second) {
  std::ostringstream text;
  if (points_per_second >= 1e6) {
    text << std::setprecision(3) << points_per_second / 1e6 << " million";
  } else {
    text << std::fixed << std::setprecision(0) << points_per_second;
  }
  return text.str() + " points/s";
}

Progress::Progress(std::uint64_t total)
    : total_(total),
      terminal_(::isatty(STDERR_FILENO) == 1),
      start_(std::chrono::steady_clock::now()) {}

Progress::~Progress() {
  if (written_) std::cerr << "\n";
}

double Progress::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void Progress::reached(std::uint64_t done) {
  const double now = seconds();
  const auto tenths =
      static_cast<int>(10.0 * static_cast<double>(done) / static_cast<double>(total_));
  const bool due = terminal_ ? now - last_ >= kRewritePeriod || done == total_ : tenths > tenths_;
  if (!due) return;
  last_ = now;
  tenths_ = tenths;
  const double rate = static_cast<double>(done) / std::max(now, 1e-9);
  std::ostringstream text;
  text << std::setw(3) << 100 * done / total_ << " %, " << rateText(rate) << ", "
       << durationText(static_cast<double>(total_ - done) / std::max(rate, 1e-9));
  if (terminal_) {
    // Past std::cerr, which escapes control characters.
    std::fputs(("\r" + text.str() + kEraseToEnd).c_str(), stderr);
    written_ = true;
  } else {
    std::cerr << text.str() << "\n";
  }
}

}  // namespace helix_arm::cli
