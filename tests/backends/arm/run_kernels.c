/* Runs kernels on memory that comes through standard input, and gives the memory back through standard output.
   A call: the kernel's number, how many arguments, and each of them: -1 and a whole number; -2 and the number
   of an argument that is the same array; or the size of an array in bytes and these. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

typedef void (*kernel)(int64_t *);
extern const kernel kernels[];

int main(void) {
    int64_t head[2], size[64], frame[64];
    while (fread(head, 8, 2, stdin) == 2) {
        for (int k = 0; k < head[1]; k++) {
            if (fread(&size[k], 8, 1, stdin) != 1) return 1;
            if (size[k] < 0) {
                if (fread(&frame[k], 8, 1, stdin) != 1) return 1;
                if (size[k] == -2) frame[k] = frame[frame[k]];
            } else {
                char *array = aligned_alloc(64, size[k] / 64 * 64 + 64);
                if (fread(array, 1, size[k], stdin) != (size_t)size[k]) return 1;
                frame[k] = (int64_t)array;
            }
        }
        kernels[head[0]](frame);
        for (int k = 0; k < head[1]; k++)
            if (size[k] >= 0) {
                fwrite((char *)frame[k], 1, size[k], stdout);
                free((char *)frame[k]);
            }
        fflush(stdout);
    }
    return 0;
}
