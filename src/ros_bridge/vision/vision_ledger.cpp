#include "vision_ledger.hpp"

#include <numeric>

#include "observations.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;

}  // namespace

const char* nameOfState(std::uint8_t state) {
  static constexpr std::array<const char*, VisionStatus::ENDED + 1> kNames = {
      "measured", "few_tags", "no_tags", "no_fit", "waiting", "stale", "camera_fault", "ended"};
  return state < kNames.size() ? kNames[state] : "in an unknown state";
}

VisionLedger::VisionLedger(const std::string& waiting) {
  status_.state = VisionStatus::WAITING;
  status_.message = "no picture was received yet from " + waiting;
}

std::uint64_t& VisionLedger::counterOf(PictureFault fault) {
  switch (fault) {
    case PictureFault::kBadJpeg:
      return status_.bad_jpeg;
    case PictureFault::kWrongEncoding:
      return status_.wrong_encoding;
    case PictureFault::kWrongSize:
      return status_.wrong_size;
    case PictureFault::kBadCameraInfo:
      return status_.bad_camera_info;
    case PictureFault::kBadModel:
      return status_.bad_model;
    case PictureFault::kSource:
      break;
  }
  return status_.source_faults;
}

void VisionLedger::refused(const PictureRefusal& refusal) {
  FaultCount& count = faults_[static_cast<std::size_t>(refusal.fault)];
  const bool tell = count.add();
  counterOf(refusal.fault) = count.total();
  status_.last_fault = refusal.message;
  if (!tell) return;
  logWarning("%s (%s, %lu so far)", refusal.message.c_str(), nameOf(refusal.fault), count.total());
}

void VisionLedger::saw(const vision::Observation& observation, int tags) {
  status_.unknown_ids.assign(observation.unknown_ids.begin(), observation.unknown_ids.end());
  status_.repeated_ids.assign(observation.repeated_ids.begin(), observation.repeated_ids.end());
  status_.unknown_tags += observation.unknown_ids.size();
  status_.repeated_tags += observation.repeated_ids.size();
  status_.tags = static_cast<std::uint32_t>(tags);
  if (observation.state == vision::ObservationState::kMeasured) ++status_.measured;
}

bool VisionLedger::enter(std::uint8_t state, const std::string& message) {
  const bool changed = state != status_.state;
  status_.state = state;
  status_.message = message;
  if (state != VisionStatus::MEASURED && state != VisionStatus::FEW_TAGS &&
      state != VisionStatus::NO_TAGS && state != VisionStatus::NO_FIT) {
    status_.tags = 0;
    status_.unknown_ids.clear();
    status_.repeated_ids.clear();
  }
  const bool told = state == VisionStatus::CAMERA_FAULT;  // by refused()
  if (changed && !told && states_.at(state).add()) {
    const bool fine = state == VisionStatus::MEASURED || state == VisionStatus::ENDED;
    logLine(fine ? ros::console::levels::Info : ros::console::levels::Warn, "%s: %s",
            nameOfState(state), message.c_str());
  }
  return changed;
}

void VisionLedger::report(DiagnosticStatus& camera, DiagnosticStatus& measurement, double seconds) {
  const auto rate = [&](std::uint64_t now, std::uint64_t then) {
    return fixed(static_cast<double>(now - then) / seconds);
  };
  const auto total = std::accumulate(
      faults_.begin(), faults_.end(), std::uint64_t{0},
      [](std::uint64_t sum, const FaultCount& count) { return sum + count.total(); });
  const bool news = total > reported_faults_;
  reported_faults_ = total;
  const bool down =
      status_.state == VisionStatus::STALE || status_.state == VisionStatus::CAMERA_FAULT;
  const bool waits = status_.state == VisionStatus::WAITING;
  camera.level = down            ? DiagnosticStatus::ERROR
                 : news || waits ? DiagnosticStatus::WARN
                                 : DiagnosticStatus::OK;
  camera.message = down || waits ? status_.message
                   : news        ? status_.last_fault
                                 : "pictures are received";
  addValue(camera, names::kPictureRateKey, rate(status_.pictures, reported_.pictures));
  addValue(camera, "pictures", std::to_string(status_.pictures));
  addValue(camera, "skipped", std::to_string(status_.skipped));
  for (int i = 0; i < kPictureFaultCount; ++i) {
    addValue(camera, nameOf(PictureFault(i)), std::to_string(faults_[i].total()));
  }
  addValue(camera, "calibration", calibration_);
  addValue(camera, names::kLastFaultKey, status_.last_fault);

  measurement.level = measured() ? DiagnosticStatus::OK : DiagnosticStatus::WARN;
  measurement.message = status_.message;
  addValue(measurement, "state", nameOfState(status_.state));
  addValue(measurement, names::kMeasuredRateKey, rate(status_.measured, reported_.measured));
  addValue(measurement, "tags", std::to_string(status_.tags));
  addValue(measurement, "unknown_ids",
           listOf({status_.unknown_ids.begin(), status_.unknown_ids.end()}));
  addValue(measurement, "repeated_ids",
           listOf({status_.repeated_ids.begin(), status_.repeated_ids.end()}));
  addValue(measurement, "model_lag_s", model_lag_ ? fixed(*model_lag_, 3) : "");
  reported_ = status_;
}

}  // namespace helix_arm::ros_bridge
