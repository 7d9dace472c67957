// Bytes of values and back. One `visit` a type serves both ways, so they cannot disagree.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace trackfield {

struct Writer {
    std::string bytes;
    void raw(void *p, size_t n) { bytes.append(static_cast<const char *>(p), n); }
    static constexpr bool reading = false;
};

struct Reader {
    const char *at, *end;
    void raw(void *p, size_t n) {
        if (size_t(end - at) < n) throw std::runtime_error("the snapshot ends too early");
        if (n) std::memcpy(p, at, n);
        at += n;
    }
    static constexpr bool reading = true;
};

template <class Ar, class T>
    requires std::is_arithmetic_v<T>
void visit(Ar &ar, T &v) {
    ar.raw(&v, sizeof v);
}

template <class Ar, class T>
void visit(Ar &ar, std::vector<T> &v) {
    uint64_t n = v.size();
    ar.raw(&n, sizeof n);
    if constexpr (Ar::reading) {
        if (n > size_t(ar.end - ar.at)) throw std::runtime_error("the snapshot is damaged");
        v.resize(n);
    }
    if constexpr (std::is_arithmetic_v<T>)
        ar.raw(v.data(), n * sizeof(T));
    else
        for (T &x : v) visit(ar, x);
}

template <class Ar, class... T>
void visit_all(Ar &ar, T &...fields) {
    (visit(ar, fields), ...);
}

}  // namespace trackfield
