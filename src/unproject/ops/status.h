// What the functions of kernels return: 0, or 1 where memory was used up. No exception may pass into a caller in C:
// it would end the process.

#pragma once

#include <new>
#include <stdexcept>

template <class F>
int status_of(F f) noexcept {
    try {
        f();
        return 0;
    } catch (const std::bad_alloc&) {
        return 1;
    } catch (const std::length_error&) {  // a vector longer than any may be
        return 1;
    }
}
