#pragma once

#include <Eigen/Core>
#include <limits>
#include <stdexcept>

#include "helix_arm/control/safety.hpp"

namespace helix_arm::regulator {

/// The link or the device is down: reconnect.
class LinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A device gave an invalid answer: garbage, half a line, the wrong unit. The exchange failed; the
/// link may still be good.
class BadReply : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Readings of a device.
struct Pressures {
  explicit Pressures(int channels)
      : pressure(Eigen::VectorXd::Constant(channels, std::numeric_limits<double>::quiet_NaN())) {}

  Eigen::VectorXd pressure;  ///< (channels) gauge [Pa]; NaN if not read this time
  double supply = std::numeric_limits<double>::quiet_NaN();  ///< gauge [Pa]; NaN if not measured
};

/// Interface of a pressure regulator. The driver converts units: its callers use gauge pascals.
///
/// For use by one thread. Calls block for at most the device's timeout per exchange.
class Driver {
 public:
  virtual ~Driver() = default;

  /// Opens the link and makes the device ready and vented. An open link is closed first. Until
  /// close(), no other program on this machine can use the device.
  /// @throws LinkError naming the device, the cause and the remedy.
  virtual void connect() = 0;
  /// Sends the orders to the device.
  /// @throws LinkError, BadReply.
  virtual void write(const control::ValveOrders& orders) = 0;
  /// Readings of all channels, in the arm's order; a device that answers one channel at a time may
  /// give only some of them, the others are NaN.
  /// @throws LinkError, BadReply.
  virtual void read(Pressures& pressures) = 0;
  /// Vents every channel, with as few messages as possible. May also be called after a LinkError
  /// until the link is closed: a device whose answers are lost or late may still receive.
  /// @throws LinkError, BadReply.
  virtual void vent() = 0;
  /// Whether the device would keep its air if the link were closed now. Such a device needs the
  /// link until it is empty.
  virtual bool keepsAirOnClose() const noexcept { return false; }
  /// Time without a line after which the device vents by itself [s]; infinite if it is not known to
  /// do so. Once it may have vented, write() and read() throw LinkError, so that its channels
  /// receive no further set points.
  virtual double watchdog() const noexcept { return std::numeric_limits<double>::infinity(); }
  /// Closes the link without sending anything. No effect if it is closed.
  virtual void close() noexcept = 0;
  /// Makes connect() succeed even if another program on this machine drives the device. For a
  /// guard, which must vent in any case. No effect on a serial line, which cannot be shared.
  virtual void ignoreOthers() noexcept {}
};

}  // namespace helix_arm::regulator
