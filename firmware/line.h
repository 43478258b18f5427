#pragma once

/// Takes one received byte, if there is one, and answers a line that it ends: the protocol of
/// config/regulators/generic.yaml. A line may end in a checksum; after the first one that is right,
/// or from the start with CHECKSUM_REQUIRED, every line must, and every answer does.
void lineRun(void);
/// One millisecond: drops a line that stands still.
void lineTick(void);
