#include "camera_source.hpp"

#include <algorithm>
#include <chrono>
#include <memory>
#include <thread>

#include "command.hpp"
#include "interrupt_watch.hpp"

namespace helix_arm::cli {
namespace {

constexpr double kPatience = 5;  // for the first or next picture of a webcam [s]
constexpr std::chrono::milliseconds kBetweenTries(20);

double steadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void readWebcam(const CameraSource& source,
                const std::function<bool(const vision::Frame&, bool)>& take, PicturesRead& read) {
  const auto camera = vision::FrameSource::webcam(source.webcam);
  const double begin = steadySeconds();
  double last = begin, retry = begin;
  vision::Frame frame;
  while (!interrupted() && steadySeconds() - begin < source.seconds) {
    if (steadySeconds() < retry) {
      std::this_thread::sleep_for(kBetweenTries);
      continue;
    }
    if (camera->next(frame) == vision::FrameStatus::kFrame) {
      last = steadySeconds();
      ++read.pictures;
      if (!take(frame, true)) return;
      continue;
    }
    retry = steadySeconds() + frame.retry_after;
    if (steadySeconds() - last < kPatience) continue;
    read.faults.emplace_back(frame);
    return;
  }
  // The time was shorter than the patience.
  if (read.pictures == 0 && !frame.fault.empty()) read.faults.emplace_back(frame);
}

}  // namespace

PictureFault::PictureFault(const vision::Frame& frame) : name(frame.name), reason(frame.fault) {
  // Of a video, the name has the number of the frame behind #, which the fault may lack.
  for (const std::string& prefix : {name, name.substr(0, name.rfind('#'))}) {
    if (reason.compare(0, prefix.size() + 2, prefix + ": ") != 0) continue;
    reason.erase(0, prefix.size() + 2);
    return;
  }
}

std::optional<std::string> whyNoPicture(const PicturesRead& read) {
  if (read.pictures > 0 || read.faults.empty()) return std::nullopt;
  const PictureFault& first = read.faults.front();
  const std::size_t others = read.faults.size() - 1;
  return "no picture could be read: " + first.name + ": " + first.reason +
         (others > 0 ? ", and " + std::to_string(others) + " others" : "");
}

PicturesRead readPictures(const CameraSource& source,
                          const std::function<bool(const vision::Frame&, bool)>& take) {
  PicturesRead read;
  const InterruptWatch watch;
  if (source.isWebcam()) {
    readWebcam(source, take, read);
    read.interrupted = interrupted();
    return read;
  }
  if (std::find(source.sources.begin(), source.sources.end(), kWebcam) != source.sources.end()) {
    throw CallerError("--source has webcam beside files; give either");
  }
  std::vector<std::unique_ptr<vision::FrameSource>> files;
  for (const std::string& path : source.sources) {
    files.push_back(vision::FrameSource::files(path, source.expected));
  }
  vision::Frame frame;
  for (const auto& file : files) {
    for (;;) {
      const vision::FrameStatus status = file->next(frame);
      if (status == vision::FrameStatus::kEnd) break;
      read.interrupted = interrupted();
      if (read.interrupted) return read;
      if (status == vision::FrameStatus::kFault) {
        read.faults.emplace_back(frame);
        continue;
      }
      ++read.pictures;
      if (!take(frame, file->continuous())) return read;
    }
  }
  return read;
}

}  // namespace helix_arm::cli
