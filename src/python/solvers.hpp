#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::python {

/// Solvers of one model that are not in use, of any options: the last ones that were given back.
/// Making one samples a thousand starts, which takes 50 times as long as a target. Threads may
/// share them.
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
  /// How many were made.
  std::int64_t made() const { return made_; }

 private:
  struct Kept {
    statics::InverseOptions options;
    std::unique_ptr<statics::InverseSolver> solver;
  };

  void giveBack(const statics::InverseOptions& options,
                std::unique_ptr<statics::InverseSolver> solver) noexcept;

  const statics::ArmModel& model_;
  std::atomic<std::int64_t> made_{0};
  basics::Mutex mutex_;
  std::vector<Kept> kept_ HELIX_ARM_GUARDED_BY(mutex_);  // the last is at the end
};

}  // namespace helix_arm::python
