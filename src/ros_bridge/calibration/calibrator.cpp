#include "calibrator.hpp"

#include <exception>
#include <filesystem>
#include <system_error>
#include <utility>

#include "bag/bag_captures.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "ros_bridge/common/log.hpp"

namespace helix_arm::ros_bridge {

JobSlot::Claim::Claim(JobSlot& slot, Job job) : slot_(slot) {
  const basics::MutexLock lock(slot_.mutex_);
  slot_.requireIdle();
  slot_.job_ = job;
}

JobSlot::Claim::~Claim() {
  const basics::MutexLock lock(slot_.mutex_);
  slot_.job_ = Job::kNone;
}

bool JobSlot::runs() const {
  const basics::MutexLock lock(mutex_);
  return job_ == Job::kRun;
}

void JobSlot::requireIdle() const {
  basics::require(job_ != Job::kRun, "run_calibration is running; wait for it, or cancel it first");
  basics::require(job_ != Job::kFit, "a fit is running; wait for it");
}

namespace {

void makeFolder(const std::string& folder) {
  std::error_code fault;
  std::filesystem::create_directories(folder, fault);
  if (fault) {
    logWarning(
        "the folder %s does not exist and cannot be created (%s): services cannot use files in it",
        folder.c_str(), fault.message().c_str());
  }
}

}  // namespace

Calibrator::Calibrator(const std::string& data_folder, const std::string& out_folder,
                       const procedures::SettleRules& rules, SceneFile scene_file)
    : data_access_({{data_folder, "~data_folder"}, {out_folder, "~out_folder"}}),
      out_access_({{out_folder, "~out_folder"}}),
      rules_(rules),
      scene_file_(std::move(scene_file)) {
  makeFolder(data_folder);
  makeFolder(out_folder);
}

std::string Calibrator::tablePath(const std::string& data) const {
  return data_access_.toRead("data", data, {".csv"});
}

std::string Calibrator::scenePath(const std::string& out) const {
  return out.empty() ? out : out_access_.toWrite("out", out, {".yaml"});
}

std::string Calibrator::savePath(const std::string& path) const {
  return out_access_.toWrite("path", path, {".yaml", ".csv"});
}

procedures::CalibrationData Calibrator::load(const io::Scene& scene,
                                             const std::vector<std::string>& paths) const {
  std::vector<std::string> allowed;
  for (const std::string& path : paths) {
    allowed.push_back(data_access_.toRead("data", path, {".csv", ".bag"}));
  }
  return loadMeasurements(scene, allowed, rules_);
}

void Calibrator::check(const std::vector<std::string>& fit) const {
  // An unknown word throws; missing data does not.
  procedures::CalibrationRequest request;
  request.fit = fit;
  procedures::runCalibration(scene_file_().path, {}, request, {});
}

procedures::CalibrationOutcome Calibrator::calibrate(const procedures::CalibrationRequest& request,
                                                     const procedures::CalibrationData& data,
                                                     const std::string& out,
                                                     const std::function<bool()>& cancelled) {
  const ReloadServer::File file = scene_file_();
  basics::require(io::sha256OfFile(file.path) == file.sha256, file.path,
                  " changed on disk since it was loaded; call reload first");
  procedures::CalibrationOutcome outcome = procedures::runCalibration(file.path, {}, request, data);
  if (!outcome.success) return outcome;
  if (cancelled()) {
    outcome.success = false;
    outcome.message = "cancelled";
    return outcome;
  }
  {
    const basics::MutexLock lock(mutex_);
    last_ = outcome.scene_text;
  }
  if (out.empty()) return outcome;
  try {
    io::writeFileAtomically(scenePath(out), outcome.scene_text);
  } catch (const std::exception& fault) {
    outcome.success = false;
    outcome.message +=
        ", but it is not saved: " + std::string(fault.what()) + "; call save with another path";
  }
  return outcome;
}

std::optional<std::string> Calibrator::last() const {
  const basics::MutexLock lock(mutex_);
  return last_;
}

void Calibrator::forgetLast() {
  const basics::MutexLock lock(mutex_);
  last_.reset();
}

}  // namespace helix_arm::ros_bridge
