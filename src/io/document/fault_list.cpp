#include "helix_arm/io/fault_list.hpp"

#include <algorithm>

#include "basics/quote.hpp"

namespace helix_arm::io {
namespace {

// So often one fault is told, each time with another line.
constexpr int kMostAlike = 5;

// Shortened, without cutting a UTF-8 character.
std::string shortened(const std::string& text, std::size_t most) {
  if (text.size() <= most) return text;
  std::size_t end = most;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
  return text.substr(0, end) + "...";
}

}  // namespace

void FaultList::add(int line, const std::string& fault) {
  ++count_;
  if (faults_.size() >= kMostKept) return;
  // Whatever a document holds: one fault is one line.
  const std::string text = " " + basics::printable(shortened(fault, kMostBytes));
  // A column of another kind breaks its rule in every row of a table.
  const auto alike =
      std::count_if(faults_.begin(), faults_.end(), [&text](const std::string& kept) {
        return kept.size() >= text.size() &&
               kept.compare(kept.size() - text.size(), text.size(), text) == 0;
      });
  if (alike >= kMostAlike) return;
  faults_.push_back(basics::printable(file_) + (line > 0 ? ":" + std::to_string(line) : "") + text);
}

void FaultList::append(const FaultList& other) {
  for (const std::string& fault : other.faults_) {
    if (faults_.size() < kMostKept) faults_.push_back(fault);
  }
  count_ += other.count_;
}

void FaultList::throwIfAny() const {
  if (empty()) return;
  std::string message;
  for (const std::string& fault : faults_) message += (message.empty() ? "" : "\n") + fault;
  if (count_ > faults_.size()) {
    message += "\n" + basics::printable(file_) + " has " + std::to_string(count_ - faults_.size()) +
               " more faults";
  }
  throw DocumentError(message);
}

}  // namespace helix_arm::io
