#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::io {

/// What is wrong with a document: all of it at once, one line a fault: `file:line key value rule`.
class FaultList {
 public:
  explicit FaultList(std::string file) : file_(std::move(file)) {}

  /// @param line  counted from 1; 0 where a fault has no line of its own.
  void add(int line, const std::string& fault);
  /// Adds the faults of another document, each with its own file.
  void append(const FaultList& other);
  bool empty() const { return faults_.empty(); }
  const std::vector<std::string>& faults() const { return faults_; }
  /// @throws DocumentError with every fault when there are any.
  void throwIfAny() const;

 private:
  std::string file_;
  std::vector<std::string> faults_;
};

/// A document that breaks its rules; what() holds every fault, one a line.
class DocumentError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace helix_arm::io
