/* The numbers of a law, for ctc_law.c alone: memory at the start, and places in it, in words. */
typedef int code(int64_t *result, void **error, int64_t places);

@DATA@
