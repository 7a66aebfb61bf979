"""bxCAN's bits by the reference manual's names (RM0090 section 32.9). Never: behaviour."""

BASE = 0x40006400
SIZE = 0x800
"""CAN1, and CAN2 right behind it."""
CONTROLLER_SIZE = 0x400

INRQ, SLEEP, TXFP, RFLM, NART, AWUM, ABOM, TTCM = (1 << k for k in range(8))  # MCR
RESET = 1 << 15
MCR_RESET = 0x00010002

INAK, SLAK, ERRI, WKUI, SLAKI = (1 << k for k in range(5))  # MSR
TXM, RXM, SAMP, RX = (1 << k for k in range(8, 12))

RQCP, TXOK, ALST, TERR = (1 << k for k in range(4))  # TSR, of mailbox 0; the next one's are 8 bits up
ABRQ = 1 << 7
OUTCOME = RQCP | TXOK | ALST | TERR
TME0 = 26  # bit number of mailbox 0's
LOW0 = 29
TSR_RESET = 0x1C000000
MAILBOXES = 3

TXRQ, RTR, IDE = 1, 2, 4  # TIxR and RIxR
TGT = 1 << 8  # TDTxR

FULL, FOVR, RFOM = 1 << 3, 1 << 4, 1 << 5  # RFxR

TMEIE, FMPIE0, FFIE0, FOVIE0, FMPIE1, FFIE1, FOVIE1 = (1 << k for k in range(7))  # IER
EWGIE, EPVIE, BOFIE, LECIE = (1 << k for k in range(8, 12))
ERRIE, WKUIE, SLKIE = (1 << k for k in range(15, 18))

EWGF, EPVF, BOFF = 1, 2, 4  # ESR
LEC = 7 << 4

SILM, LBKM = 1 << 31, 1 << 30  # BTR
BTR_RESET = 0x01230000
BTR_WRITABLE = 0xC37F03FF

FINIT = 1  # FMR
CAN2SB = 0x3F << 8
FMR_RESET = 0x2A1C0E01
BANKS = 28
ALL_BANKS = (1 << BANKS) - 1
