// Random numbers whose whole state is four words, so that a state value can carry them (xoshiro256++).
#pragma once

#include <cstdint>

namespace trackfield {

struct Xoshiro {
    uint64_t s[4];

    uint64_t next() {
        const uint64_t out = rotated(s[0] + s[3], 23) + s[0], shifted = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= shifted;
        s[3] = rotated(s[3], 45);
        return out;
    }

    // Uniform in (0, 1): never 0, so that its logarithm is finite.
    double uniform() { return (double(next() >> 11) + 0.5) * 0x1p-53; }

    // Uniform in 0 .. n-1; its bias of n / 2^64 is far below what any run can see.
    int below(int n) { return int((unsigned __int128)(next()) * unsigned(n) >> 64); }

  private:
    static uint64_t rotated(uint64_t x, int by) { return (x << by) | (x >> (64 - by)); }
};

}  // namespace trackfield
