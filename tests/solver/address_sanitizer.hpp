#pragma once

// ASTERISM_TEST_ASAN where AddressSanitizer has replaced malloc.
#if defined(__SANITIZE_ADDRESS__)
#define ASTERISM_TEST_ASAN
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define ASTERISM_TEST_ASAN
#endif
#endif
