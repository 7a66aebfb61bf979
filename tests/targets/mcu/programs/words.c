/* A program with a C library, a constructor and a heap; it says what it found, and sleeps. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char said[64];
static int constructed;
static const char *const names[] = { "zeta", "alpha", "my", "beta" };

__attribute__((constructor)) static void construct(void)
{
	constructed = 7;
}

static int by_name(const void *a, const void *b)
{
	return strcmp(*(const char *const *)a, *(const char *const *)b);
}

int main(void)
{
	const char **sorted = malloc(sizeof names);
	memcpy(sorted, names, sizeof names);
	qsort(sorted, 4, sizeof *sorted, by_name);
	volatile long long large = -1234567890123;
	int part = (int)(large / 7 % 100000);
	snprintf(said, sizeof said, "%s %s %d %s %d", sorted[0], sorted[3], constructed, sorted[2], part);
	for (;;)
		__asm volatile("wfi");
}
