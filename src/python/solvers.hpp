#pragma once

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::python {

/// Solvers of one model that are not in use. Making one samples a thousand starts, which takes 50
/// times as long as a target. Threads may share them.
class Solvers {
 public:
  /// A solver of one thread, until its end.
  class Loan {
   public:
    Loan(Solvers& owner, const statics::InverseOptions& options,
         std::unique_ptr<statics::InverseSolver> solver)
        : owner_(owner), options_(options), solver_(std::move(solver)) {}
    ~Loan();
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    statics::InverseSolver& solver() const { return *solver_; }

   private:
    Solvers& owner_;
    statics::InverseOptions options_;
    std::unique_ptr<statics::InverseSolver> solver_;
  };

  /// @param model  must outlive the solvers.
  explicit Solvers(const statics::ArmModel& model);
  /// @throws as InverseSolver does.
  Loan take(const statics::InverseOptions& options);

 private:
  void giveBack(const statics::InverseOptions& options,
                std::unique_ptr<statics::InverseSolver> solver) noexcept;

  const statics::ArmModel& model_;
  std::mutex guard_;
  statics::InverseOptions options_;  // of those that are kept
  std::vector<std::unique_ptr<statics::InverseSolver>> kept_;
};

}  // namespace helix_arm::python
