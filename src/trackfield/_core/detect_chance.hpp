// Chance as a pure function of (key, counter): the state of the generator is one number.
#pragma once

#include <cstdint>

namespace trackfield::detect {

constexpr double kSumSigma = 37837.22724161132;  // of four uniform 16-bit numbers: 65536 / sqrt(3)

// splitmix64 at a place of its sequence (Steele, Lea, Flood 2014).
inline uint64_t scrambled(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

struct Chance {
    uint64_t key = 0, used = 0;

    uint64_t bits(uint64_t i) const { return scrambled(key + (used + i + 1) * 0x9e3779b97f4a7c15ULL); }
    double uniform(uint64_t i) const { return double(bits(i) >> 11) * 0x1p-53; }

    // Nearly normal: four 16-bit uniforms summed, standardised. Within 3.46 sigma, no libm, so that
    // every machine draws the same.
    double normal(uint64_t i) const {
        const uint64_t b = bits(i);
        const int64_t sum = (b & 0xffff) + (b >> 16 & 0xffff) + (b >> 32 & 0xffff) + (b >> 48);
        return double(sum - 131070) / kSumSigma;
    }

    void spend(uint64_t n) { used += n; }
};

}  // namespace trackfield::detect
