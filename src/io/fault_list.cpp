#include "helix_arm/io/fault_list.hpp"

#include <algorithm>

namespace helix_arm::io {
namespace {

// A file of quite another kind breaks a rule on every line; nobody reads further than this.
constexpr std::size_t kMostShown = 100;

}  // namespace

void FaultList::add(int line, const std::string& fault) {
  faults_.push_back(file_ + (line > 0 ? ":" + std::to_string(line) : "") + " " + fault);
}

void FaultList::append(const FaultList& other) {
  faults_.insert(faults_.end(), other.faults_.begin(), other.faults_.end());
}

void FaultList::throwIfAny() const {
  if (faults_.empty()) return;
  std::string message;
  for (std::size_t i = 0; i < std::min(faults_.size(), kMostShown); ++i) {
    message += (i == 0 ? "" : "\n") + faults_[i];
  }
  if (faults_.size() > kMostShown) {
    message +=
        "\n" + file_ + " has " + std::to_string(faults_.size() - kMostShown) + " more faults";
  }
  throw DocumentError(message);
}

}  // namespace helix_arm::io
