#include "ros_bridge/calibration/calibration_services.hpp"

#include <cstdint>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "answers.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

template <class Value>
Value wordOf(const char* what, const std::string& given,
             const std::vector<std::pair<const char*, Value>>& words) {
  if (given.empty()) return words.front().second;
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    list += (list.empty() ? "" : " or ") + std::string(word);
  }
  throw std::invalid_argument(std::string(what) + " is '" + basics::quoted(given) + "'; expected " +
                              list);
}

procedures::CalibrationRequest requestOf(const Calibrate::Request& request) {
  procedures::CalibrationRequest out;
  out.fit = request.fit;
  out.curvature_noise = request.curvature_noise_rad;
  out.corner_noise = request.corner_noise_px;
  out.position_noise = request.position_noise_m;
  out.rotation_noise = request.rotation_noise_rad;
  out.date = procedures::utcNow();
  return out;
}

procedures::CalibrationRequest requestOf(const FitContraction::Request& request) {
  using estimation::Branch;
  using estimation::CurveKind;
  procedures::CalibrationRequest out;
  out.fit = {"contraction"};
  out.contraction = request.contraction;
  out.curve = wordOf<CurveKind>("kind", request.kind,
                                {{"quintic", CurveKind::kQuintic}, {"table", CurveKind::kTable}});
  out.branch = wordOf<Branch>(
      "branch", request.branch,
      {{"both", Branch::kBoth}, {"rising", Branch::kRising}, {"falling", Branch::kFalling}});
  out.date = procedures::utcNow();
  return out;
}

void fillCurve(FitContraction::Response& response, const estimation::ContractionFit& fit) {
  if (!fit.curve) return;
  response.rms = fit.rms;
  response.constrained = fit.constrained;
  if (fit.hysteresis) response.hysteresis = *fit.hysteresis;
  if (fit.kind == estimation::CurveKind::kQuintic) {
    response.coefficients.assign(fit.coefficients.begin(), fit.coefficients.end());
    response.reference_pressure = fit.reference_pressure;
  } else {
    response.pressures = fit.pressures;
    response.lengths = fit.lengths;
  }
}

bool neverCancelled() { return false; }

}  // namespace

CalibrationServices::CalibrationServices(ros::NodeHandle& node, JobSlot& jobs, Recorder& recorder,
                                         Calibrator& calibrator)
    : jobs_(jobs),
      recorder_(recorder),
      calibrator_(calibrator),
      calibrate_(serve(node, names::kCalibrate, &CalibrationServices::onCalibrate, this)),
      fit_contraction_(
          serve(node, names::kFitContraction, &CalibrationServices::onFitContraction, this)),
      record_(serve(node, names::kRecordSample, &CalibrationServices::onRecord, this)),
      clear_(serve(node, names::kClearSamples, &CalibrationServices::onClear, this)),
      save_(serve(node, names::kSave, &CalibrationServices::onSave, this)) {}

bool CalibrationServices::onRecord(RecordSample::Request&, RecordSample::Response& response) {
  return answer(names::kRecordSample, response, [&] {
    response.samples = static_cast<std::uint32_t>(recorder_.count());
    jobs_.whileIdle([&] {
      const procedures::Sample sample = recorder_.record();
      response.samples = static_cast<std::uint32_t>(recorder_.count());
      response.tags = static_cast<std::uint32_t>(sample.tags.size());
      response.pressure.assign(sample.pressure.begin(), sample.pressure.end());
    });
    response.success = true;
    response.message = "sample " + std::to_string(response.samples) + " with " +
                       std::to_string(response.tags) + " tags";
  });
}

bool CalibrationServices::onClear(ClearSamples::Request&, ClearSamples::Response& response) {
  return answer(names::kClearSamples, response, [&] {
    jobs_.whileIdle([&] {
      response.cleared = static_cast<std::uint32_t>(recorder_.clear());
      calibrator_.forgetLast();
    });
    response.success = true;
    response.message = std::to_string(response.cleared) + " samples cleared";
  });
}

bool CalibrationServices::onSave(Save::Request& request, Save::Response& response) {
  return answer(names::kSave, response, [&] {
    const std::string path = calibrator_.savePath(request.path);
    const auto [recording, last] =
        jobs_.whileIdle([&] { return std::pair(recorder_.recording(), calibrator_.last()); });
    std::string text;
    if (std::filesystem::path(path).extension() == ".csv") {
      basics::require(!recording.samples.empty(),
                      "no sample was recorded; call record_sample first");
      text = recording.table();
      response.message = std::to_string(recording.samples.size()) + " samples in " + path;
      if (!recording.series.empty()) {
        const std::string beside = calibrator_.savePath(
            std::filesystem::path(path).replace_extension().string() + "_series.csv");
        io::writeFileAtomically(beside, recording.seriesTable());
        response.message += " and a series of " + std::to_string(recording.series.history.rows()) +
                            " rows in " + beside;
      }
    } else {
      basics::require(last.has_value(), "nothing was calibrated; call calibrate first");
      text = *last;
      response.message = "the last calibration of " + recording.scene.name + " in " + path;
    }
    io::writeFileAtomically(path, text);
    response.success = true;
  });
}

bool CalibrationServices::onCalibrate(Calibrate::Request& request, Calibrate::Response& response) {
  response.held_out_error = std::numeric_limits<double>::quiet_NaN();
  return answer(names::kCalibrate, response, [&] {
    const std::string out = calibrator_.scenePath(request.out);
    const JobSlot::Claim fit(jobs_, JobSlot::Job::kFit);
    const procedures::CalibrationData data =
        request.data.empty() ? recorder_.recording().data()
                             : calibrator_.load(recorder_.scene(), request.data);
    fill(response, calibrator_.calibrate(requestOf(request), data, out, neverCancelled), out);
  });
}

bool CalibrationServices::onFitContraction(FitContraction::Request& request,
                                           FitContraction::Response& response) {
  response.hysteresis = std::numeric_limits<double>::quiet_NaN();
  return answer(names::kFitContraction, response, [&] {
    const procedures::CalibrationRequest job = requestOf(request);
    const std::string path = calibrator_.tablePath(request.data);
    const std::string out = calibrator_.scenePath(request.out);
    const JobSlot::Claim fit(jobs_, JobSlot::Job::kFit);
    const procedures::CalibrationData data =
        procedures::loadCalibrationData(recorder_.scene(), {path});
    basics::require(!data.lengths.empty(), path,
                    " holds no free lengths; expected the columns pressure_kpa and length_m");
    const procedures::CalibrationOutcome outcome =
        calibrator_.calibrate(job, data, out, neverCancelled);
    response.success = outcome.success;
    response.message = outcome.message;
    if (outcome.success) response.out = out;
    if (!outcome.contractions.empty()) {
      fillCurve(response, outcome.contractions.front().second);
    }
  });
}

}  // namespace helix_arm::ros_bridge
