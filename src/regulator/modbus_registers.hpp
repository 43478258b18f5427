#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

namespace helix_arm::regulator {

/// A set of registers in consecutive runs, as Modbus transfers them.
class ModbusRegisters {
 public:
  struct Run {
    int first;
    std::vector<std::uint16_t> words;
  };

  /// @param longest  longest run, >= 1.
  ModbusRegisters(const std::set<int>& registers, int longest) {
    for (const int number : registers) {
      const bool fits =
          !runs_.empty() && number == end(runs_.back()) && number < runs_.back().first + longest;
      if (!fits) runs_.push_back({number, {}});
      runs_.back().words.push_back(0);
    }
  }

  /// A register from the constructor's set.
  std::uint16_t& at(int number) {
    return const_cast<std::uint16_t&>(std::as_const(*this).at(number));
  }
  const std::uint16_t& at(int number) const {
    const auto run = std::find_if(runs_.begin(), runs_.end(),
                                  [number](const Run& r) { return number < end(r); });
    return run->words.at(static_cast<std::size_t>(number - run->first));
  }

  std::vector<Run>& runs() { return runs_; }
  void clear() {
    for (Run& run : runs_) std::fill(run.words.begin(), run.words.end(), std::uint16_t{0});
  }

 private:
  static int end(const Run& run) { return run.first + static_cast<int>(run.words.size()); }

  std::vector<Run> runs_;
};

}  // namespace helix_arm::regulator
