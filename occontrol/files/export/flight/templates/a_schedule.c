/* The schedule: which sensors measure when. C99, no heap, no recursion, no library. */
#include "occ_filter.h"

