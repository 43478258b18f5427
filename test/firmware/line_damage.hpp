#pragma once

#include "live_board.hpp"

namespace helix_arm::test {

/// Nothing arrives.
LiveBoard::Damage cut();
/// Every line is cut in half, its end included.
LiveBoard::Damage halved();
/// Random bytes, seeded, in between: one for every fourth.
LiveBoard::Damage noisy();
/// Random bytes, seeded, instead.
LiveBoard::Damage garbage();
/// A hundred foreign lines in front of every line.
LiveBoard::Damage flooded();
/// Every line comes when the next one is due.
LiveBoard::Damage late();
/// Readings in psi.
LiveBoard::Damage inPsi();
/// Readings that are no number.
LiveBoard::Damage notANumber();
/// Each channel's first reading, whatever comes after it.
LiveBoard::Damage stuck();

}  // namespace helix_arm::test
