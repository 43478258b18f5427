#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::io {

/// An override of one key, as in `--set regulator.simulated.noise_kpa=1`; list entries by number
/// (`arm.sections.0.name`).
struct Override {
  std::string key;    ///< dotted path; a key that the schema does not know is a fault
  std::string value;  ///< YAML text
};

/// How one section is drawn; no effect on the model.
struct SectionLook {
  std::string name;
  int separators = 8;              ///< discs along the section, >= 2
  double separator_radius = 0.03;  ///< [m]
  double muscle_radius = 0.008;    ///< [m]
};

/// All faults of a document, one line per fault: `file:line key value rule`, printable whatever the
/// document holds (basics::printable()).
/// The size of the list is limited: the first kMostKept faults are kept, five of those that differ
/// only in their line, each with at most kMostBytes, and the others are counted.
class FaultList {
 public:
  static constexpr std::size_t kMostKept = 100;
  /// Maximum size of a fault, without its file and line.
  static constexpr std::size_t kMostBytes = 1000;

  explicit FaultList(std::string file) : file_(std::move(file)) {}

  /// An empty list of the same document.
  FaultList ofSameFile() const { return FaultList(file_); }
  /// @param line  counted from 1; 0 if the fault has no line.
  void add(int line, const std::string& fault);
  /// Adds the faults of another document, each with its own file.
  void append(const FaultList& other);
  bool empty() const { return count_ == 0; }
  /// Number of all faults, including those not kept.
  std::size_t count() const { return count_; }
  /// The kept faults.
  const std::vector<std::string>& faults() const { return faults_; }
  /// @throws DocumentError with the kept faults and the number of the others, if there are any
  /// faults.
  void throwIfAny() const;

 private:
  std::string file_;
  std::vector<std::string> faults_;
  std::size_t count_ = 0;
};

/// A document that breaks its rules; what() holds its faults, one per line.
class DocumentError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace helix_arm::io
