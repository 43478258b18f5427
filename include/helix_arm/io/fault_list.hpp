#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::io {

/// What is wrong with a document: total area at once, one line a fault: `file:line key value rule`.
/// However many faults a document has and however long its words are, the list stays small: the
/// first kMostKept are kept, each of kMostBytes at most, and the others are counted.
class FaultList {
 public:
  static constexpr std::size_t kMostKept = 100;
  static constexpr std::size_t kMostBytes = 1000;  ///< of a fault, without its file and line

  explicit FaultList(std::string file) : file_(std::move(file)) {}

  /// An empty list of the same document.
  FaultList ofSameFile() const { return FaultList(file_); }
  /// @param line  counted from 1; 0 where a fault has no line of its own.
  void add(int line, const std::string& fault);
  /// Adds the faults of another document, each with its own file.
  void append(const FaultList& other);
  bool empty() const { return count_ == 0; }
  /// Of all faults, those that are not kept included.
  std::size_t count() const { return count_; }
  /// Those that are kept.
  const std::vector<std::string>& faults() const { return faults_; }
  /// @throws DocumentError with every fault that is kept, and the number of the others, when there
  /// are any.
  void throwIfAny() const;

 private:
  std::string file_;
  std::vector<std::string> faults_;
  std::size_t count_ = 0;
};

/// A document that breaks its rules; what() holds its faults, one a line.
class DocumentError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace helix_arm::io
